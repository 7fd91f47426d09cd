package com.flashmat.android;

import android.graphics.Bitmap;
import android.graphics.ImageFormat;
import android.graphics.PixelFormat;
import android.graphics.Rect;
import android.media.Image;
import android.os.Build;
import androidx.annotation.NonNull;
import com.flashmat.Encoding;
import com.flashmat.Frame;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.Objects;

/** Frames of what Android's cameras and decoders give. */
public final class Frames {
    private Frames() {}

    /**
     * A camera's image, where it lies: YUV_420_888 (Camera2, CameraX with {@code @ExperimentalGetImage}) or RGBA_8888
     * (CameraX's {@code OUTPUT_IMAGE_FORMAT_RGBA_8888}). Do not close the image before the capture has returned.
     *
     * <p>The image's crop rectangle is kept to; odd left and top borders of YUV images move by one pixel.
     *
     * @param rotationDegrees as {@code ImageInfo.getRotationDegrees()}, or the sensor's orientation
     */
    @NonNull
    public static Frame of(@NonNull Image image, int rotationDegrees) {
        Objects.requireNonNull(image, "image");
        Image.Plane[] planes = image.getPlanes();
        Rect crop = image.getCropRect();
        switch (image.getFormat()) {
            case ImageFormat.YUV_420_888:
                // Chroma stands for 2 x 2 pixels: begin where a chroma sample does.
                int left = crop.left & ~1;
                int top = crop.top & ~1;
                return Frame.yuv420(
                                from(planes[0], left, top),
                                planes[0].getRowStride(),
                                planes[0].getPixelStride(),
                                from(planes[1], left / 2, top / 2),
                                from(planes[2], left / 2, top / 2),
                                planes[1].getRowStride(),
                                planes[1].getPixelStride(),
                                crop.right - left,
                                crop.bottom - top)
                        .rotation(rotationDegrees)
                        .build();
            case PixelFormat.RGBA_8888:
                ByteBuffer pixels = from(planes[0], crop.left, crop.top);
                return Frame.rgba8(pixels, crop.width(), crop.height(), planes[0].getRowStride())
                        .rotation(rotationDegrees)
                        .build();
            default:
                throw new IllegalArgumentException(
                        "image format " + image.getFormat() + ": only YUV_420_888 and RGBA_8888 can be read");
        }
    }

    /** The plane from the pixel at (x, y) on. */
    private static ByteBuffer from(Image.Plane plane, int x, int y) {
        ByteBuffer buffer = plane.getBuffer().duplicate();
        buffer.position(buffer.position() + y * plane.getRowStride() + x * plane.getPixelStride());
        return buffer;
    }

    /**
     * A decoded photo. Its pixels are copied once (bitmaps have no direct buffer); it may be recycled afterwards.
     * sRGB and, from API 26, Display P3 are read as such; other colour spaces are refused: decode with
     * {@code inPreferredColorSpace} sRGB.
     *
     * @param rotationDegrees by which the bitmap must be turned clockwise to stand upright (its EXIF orientation)
     */
    @NonNull
    public static Frame of(@NonNull Bitmap bitmap, int rotationDegrees) {
        Objects.requireNonNull(bitmap, "bitmap");
        Encoding encoding = Build.VERSION.SDK_INT >= 26 ? ColourSpaces.encoding(bitmap) : Encoding.SRGB;
        Bitmap pixels = bitmap;
        if (bitmap.getConfig() != Bitmap.Config.ARGB_8888) {
            // Hardware bitmaps, RGB_565, half floats.
            pixels = bitmap.copy(Bitmap.Config.ARGB_8888, false);
            if (pixels == null) {
                throw new IllegalArgumentException("the bitmap cannot be read as ARGB_8888");
            }
        }
        ByteBuffer memory = ByteBuffer.allocateDirect(pixels.getByteCount()).order(ByteOrder.nativeOrder());
        pixels.copyPixelsToBuffer(memory);
        memory.rewind();
        int stride = pixels.getRowBytes();
        if (pixels != bitmap) {
            pixels.recycle();
        }
        // ARGB_8888 lies in memory as R, G, B, A.
        return Frame.rgba8(memory, bitmap.getWidth(), bitmap.getHeight(), stride)
                .rotation(rotationDegrees)
                .encoding(encoding)
                .build();
    }
}
