package com.flashmat;

import androidx.annotation.NonNull;
import androidx.annotation.Nullable;
import java.nio.ByteBuffer;
import java.util.Objects;

/**
 * Turns flash photos of flat materials into relightable maps.
 *
 * <p>An engine owns a model, its working memory and its threads. It captures one photo at a time: further calls from
 * other threads wait. Captures take a while; call them off the main thread. All methods may be called from any thread.
 * Close it when done: nothing else frees its memory.
 *
 * <pre>{@code
 * try (MaterialEngine engine = new MaterialEngine(model, EngineOptions.DEFAULT)) {
 *     MaterialMaps maps = engine.capture(Frame.rgba8(pixels, width, height, 4 * width).build());
 * }
 * }</pre>
 */
public final class MaterialEngine implements AutoCloseable {
    /** 0 once closed. A number that the native library looks up, so a late call is refused, not undefined. */
    private volatile long handle;
    private final int size;

    /**
     * Makes an engine; all its memory is taken here.
     *
     * @param model a model file's bytes from position to limit, in a direct buffer (mapped files are); they are copied
     * @throws FlashmatException.Model the bytes are not a model that this version can run
     * @throws FlashmatException.NetworkSize the size is not a multiple of 128, or too large
     * @throws FlashmatException.LevelUnsupported the CPU does not have the level
     * @throws FlashmatException.WorkspaceTooSmall the device is short of memory
     */
    public MaterialEngine(@NonNull ByteBuffer model, @NonNull EngineOptions options) {
        Objects.requireNonNull(model, "model");
        Objects.requireNonNull(options, "options");
        int level = options.level().number();
        handle = NativeBridge.create(model.slice(), options.size(), level, options.threads());
        size = options.size();
    }

    /** The native library's version. */
    @NonNull
    public static String version() {
        return NativeBridge.version();
    }

    private long open() {
        long open = handle;
        if (open == 0) {
            throw new IllegalStateException("the engine is closed");
        }
        return open;
    }

    /** {@link #capture(Frame, CaptureOptions, ProgressListener)} with the default options and nobody listening. */
    @NonNull
    public MaterialMaps capture(@NonNull Frame frame) {
        return capture(frame, CaptureOptions.DEFAULT, null);
    }

    /** {@link #capture(Frame, CaptureOptions, ProgressListener)} with nobody listening. */
    @NonNull
    public MaterialMaps capture(@NonNull Frame frame, @NonNull CaptureOptions options) {
        return capture(frame, options, null);
    }

    /**
     * One photo to maps, on this thread.
     *
     * @throws FlashmatException.BadPhoto another photo is needed; the message says why
     * @throws FlashmatException.Cancelled {@link #cancel()} was called or the listener returned false
     * @throws FlashmatException as the nested classes say of the frame's sizes, strides and pixels
     */
    @NonNull
    public MaterialMaps capture(
            @NonNull Frame frame, @NonNull CaptureOptions options, @Nullable ProgressListener listener) {
        return capture(frame, options, new MaterialMaps(size), listener);
    }

    /**
     * As {@link #capture(Frame, CaptureOptions, ProgressListener)}, into maps made before. When it throws, they hold
     * no capture.
     *
     * @param into of this engine's size; not read or filled by another thread meanwhile
     * @return {@code into}
     */
    @NonNull
    public MaterialMaps capture(
            @NonNull Frame frame,
            @NonNull CaptureOptions options,
            @NonNull MaterialMaps into,
            @Nullable ProgressListener listener) {
        Objects.requireNonNull(frame, "frame");
        Objects.requireNonNull(options, "options");
        Objects.requireNonNull(into, "into");
        if (into.size() != size) {
            throw new IllegalArgumentException("maps of size " + into.size() + " for an engine of size " + size);
        }
        synchronized (into) {
            into.setFilled(false);
            NativeBridge.capture(
                    open(),
                    frame.layout(),
                    frame.plane0,
                    frame.plane1,
                    frame.plane2,
                    options.fovKind,
                    options.fov,
                    options.targetFov,
                    options.lightScale,
                    options.classNumber,
                    options.refine,
                    listener,
                    into.memory,
                    into.numbers);
            into.setFilled(true);
        }
        return into;
    }

    /**
     * Stops the capture that runs and those that wait, which throw {@link FlashmatException.Cancelled} at their next
     * step; later ones run. Does not wait. Does nothing on a closed engine.
     */
    public void cancel() {
        long open = handle;
        if (open != 0) {
            NativeBridge.cancel(open);
        }
    }

    /** Pixels per side of the maps. */
    public int size() {
        return size;
    }

    /** The CPU level in use, as {@code dotprod}. */
    @NonNull
    public String level() {
        return NativeBridge.level(open());
    }

    /** Bytes of working memory. */
    public long workspaceBytes() {
        return NativeBridge.workspaceBytes(open());
    }

    /** The model's description, JSON. */
    @NonNull
    public String modelMeta() {
        return NativeBridge.modelMeta(open());
    }

    /** The model file's CRC-32. */
    public long modelChecksum() {
        return NativeBridge.modelChecksum(open());
    }

    /**
     * Frees the engine. Waits for the capture that runs ({@link #cancel()} first to wait less); captures that wait,
     * and later calls, throw {@link IllegalStateException}. Closing again does nothing.
     *
     * @throws IllegalStateException called from this engine's own progress listener, where waiting would never end;
     *     the engine stays open
     */
    @Override
    public void close() {
        long open = handle;
        if (open == 0) {
            return;
        }
        // Throws, and leaves the engine open, only on its own listener's thread.
        NativeBridge.destroy(open);
        handle = 0;
    }
}
