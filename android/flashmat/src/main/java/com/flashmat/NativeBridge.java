package com.flashmat;

import java.nio.ByteBuffer;

/**
 * The native library's exports. Nothing here is public: {@link MaterialEngine} is the way in. The native side checks
 * every argument again, so a mistake here is an exception, not a crash.
 */
final class NativeBridge {
    /** Counts changes of the signatures and layouts below; the native library has the same number. */
    static final int ABI = 4;
    /** Planes of f32 in a maps buffer: albedo 3, normal 3, roughness, re-render 3, photo 3, observability. */
    static final int PLANES = 14;
    /** Numbers of a capture: see {@link MaterialMaps}. */
    static final int NUMBERS = 29;

    static {
        // Host tests name the file; apps have it in their package.
        String file = System.getProperty("com.flashmat.library");
        if (file == null) {
            System.loadLibrary("flashmat_jni");
        } else {
            System.load(file);
        }
        if (abi() != ABI) {
            throw new UnsatisfiedLinkError(
                    "libflashmat_jni.so has ABI " + abi() + ", these classes " + ABI + ": do not mix versions");
        }
    }

    private NativeBridge() {}

    static native int abi();

    static native String version();

    static native long create(ByteBuffer model, int size, int level, int threads);

    /** Waits for the capture that runs; does nothing when the engine is closed already. */
    static native void destroy(long engine);

    /** Does nothing when the engine is closed. */
    static native void cancel(long engine);

    static native String level(long engine);

    static native long workspaceBytes(long engine);

    static native String modelMeta(long engine);

    static native long modelChecksum(long engine);

    static native void capture(
            long engine,
            int[] layout,
            ByteBuffer plane0,
            ByteBuffer plane1,
            ByteBuffer plane2,
            int fovKind,
            float fov,
            float targetFov,
            float lightScale,
            int materialClass,
            boolean refine,
            ProgressListener listener,
            ByteBuffer maps,
            float[] numbers);

    static native void picture(ByteBuffer maps, int size, int picture, ByteBuffer rgba);

    static native byte[] glb(ByteBuffer maps, int size, float f0, float fov, byte[] name);

    /** Only in builds with the feature test-hooks: throws core's error of that number; -1 panics in the engine. */
    static native void fail(long engine, int error);

    /** Called by the native library. */
    static boolean onProgress(ProgressListener listener, int stage, float fraction) {
        return listener.onProgress(Stage.of(stage), fraction);
    }
}
