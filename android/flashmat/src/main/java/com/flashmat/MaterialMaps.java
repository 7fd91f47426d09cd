package com.flashmat;

import androidx.annotation.NonNull;
import java.io.IOException;
import java.io.OutputStream;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.FloatBuffer;
import java.nio.charset.StandardCharsets;
import java.util.Arrays;
import java.util.Objects;

/**
 * A captured material: maps of {@link #size()} x {@link #size()} pixels, row by row from the top, one plane after the
 * other, and what the capture found out besides.
 *
 * <p>The buffers are read-only views of memory that this object owns; they stay valid as long as they are reachable,
 * also after the engine is closed. {@link MaterialEngine#capture(Frame, CaptureOptions, MaterialMaps,
 * ProgressListener)} overwrites them.
 */
public final class MaterialMaps {
    private static final int CLASSES = 8;

    private final int size;
    private final int plane;
    final ByteBuffer memory;
    final float[] numbers = new float[NativeBridge.NUMBERS];
    private volatile boolean filled;

    /** Memory for maps of an engine's size, to be filled by captures: spares garbage in a loop. */
    public MaterialMaps(int size) {
        // The engine's largest size; keeps the memory below 2 GB.
        if (size < 1 || size > 4096) {
            throw new IllegalArgumentException("size must be 1 to 4096: " + size);
        }
        this.size = size;
        plane = size * size;
        memory = ByteBuffer.allocateDirect(NativeBridge.PLANES * 4 * plane).order(ByteOrder.nativeOrder());
    }

    void setFilled(boolean filled) {
        this.filled = filled;
    }

    private void check() {
        if (!filled) {
            throw new IllegalStateException("no capture has filled these maps");
        }
    }

    private FloatBuffer planes(int first, int count) {
        check();
        FloatBuffer all = memory.asFloatBuffer().asReadOnlyBuffer();
        all.position(first * plane);
        all.limit((first + count) * plane);
        return all.slice();
    }

    /** Pixels per side. */
    public int size() {
        return size;
    }

    /** Diffuse colour: 3 planes R, G, B, linear, in [0,1]. */
    @NonNull
    public FloatBuffer albedo() {
        return planes(0, 3);
    }

    /** Unit normals: 3 planes x (right), y (up), z (to the camera). */
    @NonNull
    public FloatBuffer normal() {
        return planes(3, 3);
    }

    /** Roughness: 1 plane in [0,1]; alpha of the microfacet model is its square. */
    @NonNull
    public FloatBuffer roughness() {
        return planes(6, 1);
    }

    /** The maps re-rendered under the estimated flash: 3 planes, linear, as bright as the photo. */
    @NonNull
    public FloatBuffer render() {
        return planes(7, 3);
    }

    /** The photo as the pipeline saw it: 3 planes, linear, square, upright. */
    @NonNull
    public FloatBuffer photo() {
        return planes(10, 3);
    }

    /** How much the photo says about the roughness: 1 plane in [0,1]; zeros without refinement. */
    @NonNull
    public FloatBuffer observability() {
        return planes(13, 1);
    }

    /** What the classifier believes of a class; all eight sum to 1. */
    public float probability(@NonNull MaterialClass materialClass) {
        check();
        return numbers[materialClass.ordinal()];
    }

    /** All eight probabilities, in the order of {@link MaterialClass}. */
    @NonNull
    public float[] probabilities() {
        check();
        return Arrays.copyOf(numbers, CLASSES);
    }

    /** The class: the caller's, or the most probable one. */
    @NonNull
    public MaterialClass materialClass() {
        check();
        return MaterialClass.of((int) numbers[CLASSES]);
    }

    /** Specular reflectance at normal incidence. */
    public float f0() {
        check();
        return numbers[9];
    }

    /** The photo's exposure times the flash's strength. */
    public float lightScale() {
        check();
        return numbers[10];
    }

    /**
     * Even light that the re-render adds to the flash's, as a share of the flash's at the centre, in [0,1]: it adds lightScale *
     * roomLight * albedo. Fitted with {@link #lightScale}, no measurement of the room.
     */
    public float roomLight() {
        check();
        return numbers[19];
    }

    /**
     * Where the re-render's flash is, fitted to the photo: x, y, z in plane units. The plane is z = 0, x to the right, y up, the
     * camera at (0,0,1).
     */
    public float[] flash() {
        check();
        return new float[] {numbers[20], numbers[21], numbers[22]};
    }

    /** Share of the photo's own pixels, within the square, that are overexposed in red, green and blue, 0 to 1. */
    @NonNull
    public float[] overexposed() {
        check();
        return Arrays.copyOfRange(numbers, 23, 26);
    }

    /** Mean linear light of what is not overexposed, 0 to 1. */
    public float brightness() {
        check();
        return numbers[26];
    }

    /** Whether more than {@link Exposure#OVEREXPOSED} of the photo's pixels are: take it with less exposure. */
    public boolean isOverexposed() {
        check();
        return numbers[27] != 0;
    }

    /** Whether the photo is too dark for its 8 bits: take it nearer or with more exposure. */
    public boolean isDark() {
        check();
        return numbers[28] != 0;
    }

    /** RMSE of the re-render against the photo, gamma 2.2, overexposed values left out. */
    public float residual() {
        check();
        return numbers[11];
    }

    /** Field of view over the maps, in degrees. */
    public float fieldOfView() {
        check();
        return numbers[12];
    }

    /** Steps of the refinement's solvers: albedo, normal, roughness; zeros without refinement. */
    @NonNull
    public int[] solverIterations() {
        check();
        return new int[] {(int) numbers[13], (int) numbers[14], (int) numbers[15]};
    }

    /** What the refinement's solvers left: albedo, normal, roughness; zeros without refinement. */
    @NonNull
    public float[] solverResiduals() {
        check();
        return Arrays.copyOfRange(numbers, 16, 19);
    }

    /**
     * Writes a picture as RGBA8, opaque, row by row from the top, at the buffer's position, which does not move:
     * ready for {@code Bitmap.copyPixelsFromBuffer} (ARGB_8888) and {@code glTexImage2D}.
     *
     * @param rgba direct, writable, with 4 * size * size bytes from position to limit
     */
    public void encode(@NonNull Picture picture, @NonNull ByteBuffer rgba) {
        check();
        Objects.requireNonNull(picture, "picture");
        Objects.requireNonNull(rgba, "rgba");
        if (rgba.isReadOnly()) {
            throw new IllegalArgumentException("the picture's buffer is read-only");
        }
        NativeBridge.picture(memory, size, picture.ordinal(), rgba.slice());
    }

    /**
     * Writes the material on a square, as one binary glTF 2.0 file for any viewer: albedo, normals, roughness, metallic,
     * index of refraction. The same bytes as the command line's {@code material.glb} of the same capture. Does not close
     * {@code out}.
     */
    public void writeGlb(@NonNull String name, @NonNull OutputStream out) throws IOException {
        check();
        Objects.requireNonNull(name, "name");
        Objects.requireNonNull(out, "out");
        byte[] utf8 = name.getBytes(StandardCharsets.UTF_8);
        out.write(NativeBridge.glb(memory, size, f0(), fieldOfView(), utf8));
    }

    /** {@link #encode(Picture, ByteBuffer)} into a new buffer, at position 0. */
    @NonNull
    public ByteBuffer encode(@NonNull Picture picture) {
        ByteBuffer rgba = ByteBuffer.allocateDirect(4 * plane).order(ByteOrder.nativeOrder());
        encode(picture, rgba);
        return rgba;
    }
}
