package com.flashmat;

import androidx.annotation.NonNull;
import androidx.annotation.Nullable;
import java.nio.ByteBuffer;
import java.util.Objects;

/**
 * A photo's pixels where they lie: direct buffers, sizes and strides; immutable, nothing is copied.
 *
 * <p>Buffers are read from their position to their limit. They must be direct, stay as they are until the capture
 * returns (do not close a camera's image, recycle or write meanwhile), and are never written. Sizes, strides and
 * lengths are checked by the capture, before any pixel is read.
 *
 * <p>Cameras and bitmaps: see {@code com.flashmat.android.Frames}.
 */
public final class Frame {
    private enum Format {
        RGB8,
        RGBA8,
        BGRA8,
        RGB16,
        RGB_F32,
        NV12,
        NV21,
        YUV420
    }

    private final Format format;
    private final int width;
    private final int height;
    final ByteBuffer plane0;
    final ByteBuffer plane1;
    final ByteBuffer plane2;
    private final int rowStride;
    private final int pixelStride;
    private final int chromaRowStride;
    private final int chromaPixelStride;
    private final int quarterTurns;
    private final Encoding encoding;
    private final YuvMatrix matrix;
    private final YuvRange range;

    private Frame(Builder b) {
        format = b.format;
        width = b.width;
        height = b.height;
        plane0 = b.plane0;
        plane1 = b.plane1;
        plane2 = b.plane2;
        rowStride = b.rowStride;
        pixelStride = b.pixelStride;
        chromaRowStride = b.chromaRowStride;
        chromaPixelStride = b.chromaPixelStride;
        quarterTurns = b.quarterTurns;
        encoding = b.encoding;
        matrix = b.matrix;
        range = b.range;
    }

    /** Packed 8-bit R, G, B; stride in bytes. sRGB-encoded unless set otherwise, as all formats but {@link #rgbF32}. */
    @NonNull
    public static Builder rgb8(@NonNull ByteBuffer data, int width, int height, int rowStride) {
        return packed(Format.RGB8, data, width, height, rowStride);
    }

    /** Packed 8-bit R, G, B, A; alpha is not read; stride in bytes. */
    @NonNull
    public static Builder rgba8(@NonNull ByteBuffer data, int width, int height, int rowStride) {
        return packed(Format.RGBA8, data, width, height, rowStride);
    }

    /** Packed 8-bit B, G, R, A; alpha is not read; stride in bytes. */
    @NonNull
    public static Builder bgra8(@NonNull ByteBuffer data, int width, int height, int rowStride) {
        return packed(Format.BGRA8, data, width, height, rowStride);
    }

    /** Packed 16-bit R, G, B in native byte order, 2-byte aligned; stride in values of 16 bits. */
    @NonNull
    public static Builder rgb16(@NonNull ByteBuffer data, int width, int height, int rowStride) {
        return packed(Format.RGB16, data, width, height, rowStride);
    }

    /**
     * Packed float R, G, B in native byte order, 4-byte aligned; stride in floats. Linear unless set otherwise; 1 is
     * the sensor's white.
     */
    @NonNull
    public static Builder rgbF32(@NonNull ByteBuffer data, int width, int height, int rowStride) {
        return packed(Format.RGB_F32, data, width, height, rowStride).encoding(Encoding.LINEAR);
    }

    /** Semi-planar YUV 4:2:0, U before V; strides in bytes. BT.601, full range, unless set otherwise. */
    @NonNull
    public static Builder nv12(
            @NonNull ByteBuffer y, int yRowStride, @NonNull ByteBuffer uv, int uvRowStride, int width, int height) {
        return new Builder(Format.NV12, width, height).luma(y, yRowStride, 1).chroma(uv, null, uvRowStride, 2);
    }

    /** Semi-planar YUV 4:2:0, V before U. As {@link #nv12}. */
    @NonNull
    public static Builder nv21(
            @NonNull ByteBuffer y, int yRowStride, @NonNull ByteBuffer vu, int vuRowStride, int width, int height) {
        return new Builder(Format.NV21, width, height).luma(y, yRowStride, 1).chroma(vu, null, vuRowStride, 2);
    }

    /** Three planes with any row and pixel strides: I420, or Android's YUV_420_888. As {@link #nv12}. */
    @NonNull
    public static Builder yuv420(
            @NonNull ByteBuffer y,
            int yRowStride,
            int yPixelStride,
            @NonNull ByteBuffer u,
            @NonNull ByteBuffer v,
            int uvRowStride,
            int uvPixelStride,
            int width,
            int height) {
        return new Builder(Format.YUV420, width, height)
                .luma(y, yRowStride, yPixelStride)
                .chroma(u, Objects.requireNonNull(v, "v"), uvRowStride, uvPixelStride);
    }

    private static Builder packed(Format format, ByteBuffer data, int width, int height, int rowStride) {
        return new Builder(format, width, height).luma(data, rowStride, 1);
    }

    /** Pixels across, as stored (before the rotation). */
    public int width() {
        return width;
    }

    /** Pixels down, as stored (before the rotation). */
    public int height() {
        return height;
    }

    /** The numbers of the native library's {@code Layout}. */
    int[] layout() {
        return new int[] {
            format.ordinal(),
            width,
            height,
            rowStride,
            pixelStride,
            chromaRowStride,
            chromaPixelStride,
            quarterTurns,
            encoding.ordinal(),
            matrix.ordinal(),
            range.ordinal()
        };
    }

    /** Says what the pixels mean and makes the {@link Frame}. */
    public static final class Builder {
        private final Format format;
        private final int width;
        private final int height;
        private ByteBuffer plane0;
        private ByteBuffer plane1;
        private ByteBuffer plane2;
        private int rowStride;
        private int pixelStride;
        private int chromaRowStride;
        private int chromaPixelStride;
        private int quarterTurns;
        private Encoding encoding = Encoding.SRGB;
        private YuvMatrix matrix = YuvMatrix.BT601;
        private YuvRange range = YuvRange.FULL;

        private Builder(Format format, int width, int height) {
            this.format = format;
            this.width = width;
            this.height = height;
        }

        private Builder luma(ByteBuffer data, int row, int pixel) {
            plane0 = direct(data, "plane 0");
            rowStride = row;
            pixelStride = pixel;
            return this;
        }

        private Builder chroma(ByteBuffer second, @Nullable ByteBuffer third, int row, int pixel) {
            plane1 = direct(second, "plane 1");
            plane2 = third == null ? null : direct(third, "plane 2");
            chromaRowStride = row;
            chromaPixelStride = pixel;
            return this;
        }

        /** A view from position to limit: the native library sees whole buffers only. */
        private static ByteBuffer direct(ByteBuffer buffer, String what) {
            Objects.requireNonNull(buffer, what);
            if (!buffer.isDirect()) {
                throw new IllegalArgumentException(
                        what + " must be a direct ByteBuffer (ByteBuffer.allocateDirect, or a camera's)");
            }
            return buffer.slice();
        }

        /**
         * Degrees by which the stored image must be turned clockwise to stand upright: 0, 90, 180 or 270, as CameraX's
         * {@code rotationDegrees}.
         */
        @NonNull
        public Builder rotation(int degreesClockwise) {
            if (degreesClockwise % 90 != 0) {
                throw new IllegalArgumentException("rotation is not a multiple of 90 degrees: " + degreesClockwise);
            }
            quarterTurns = (degreesClockwise / 90 % 4 + 4) % 4;
            return this;
        }

        /** What the values mean. */
        @NonNull
        public Builder encoding(@NonNull Encoding encoding) {
            this.encoding = Objects.requireNonNull(encoding, "encoding");
            return this;
        }

        /** Luma equation and range of YUV pixels; other formats do not have them. */
        @NonNull
        public Builder yuvColour(@NonNull YuvMatrix matrix, @NonNull YuvRange range) {
            this.matrix = Objects.requireNonNull(matrix, "matrix");
            this.range = Objects.requireNonNull(range, "range");
            return this;
        }

        /** The frame. */
        @NonNull
        public Frame build() {
            return new Frame(this);
        }
    }
}
