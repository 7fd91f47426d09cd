package com.flashmat;

import androidx.annotation.NonNull;
import java.nio.ByteBuffer;
import java.util.Objects;

/** Tells from a camera's preview how much of a photo would be overexposed. */
public final class Exposure {
    /** Luma codes from here on count as overexposed, as in the capture. */
    private static final int CLIPPED = 254;

    /** Above this share of overexposed pixels the maps suffer; highlights of good photos take up to it. */
    public static final float OVEREXPOSED = 0.1f;

    private Exposure() {}

    /**
     * Part of the central square's pixels whose luma is at its limit, 0 to 1; looks at every {@code step}-th pixel of
     * every {@code step}-th row. A specular highlight is clipped in most good photos (a few percent); above
     * {@link #OVEREXPOSED} the maps suffer.
     *
     * @param luma the Y plane, from its position; heap or direct; not moved
     */
    public static float clippedShare(
            @NonNull ByteBuffer luma, int width, int height, int rowStride, int pixelStride, int step) {
        Objects.requireNonNull(luma, "luma");
        if (width < 1 || height < 1 || rowStride < 1 || pixelStride < 1 || step < 1) {
            throw new IllegalArgumentException("sizes, strides and step must be at least 1");
        }
        long needed = (long) (height - 1) * rowStride + (long) (width - 1) * pixelStride + 1;
        if (luma.remaining() < needed) {
            throw new IllegalArgumentException(
                    "luma has " + luma.remaining() + " bytes, at least " + needed + " needed");
        }
        int side = Math.min(width, height);
        int left = (width - side) / 2;
        int top = (height - side) / 2;
        int start = luma.position();
        long seen = 0;
        long clipped = 0;
        for (int y = top; y < top + side; y += step) {
            for (int x = left; x < left + side; x += step) {
                seen++;
                if ((luma.get(start + y * rowStride + x * pixelStride) & 0xff) >= CLIPPED) {
                    clipped++;
                }
            }
        }
        return (float) clipped / seen;
    }
}
