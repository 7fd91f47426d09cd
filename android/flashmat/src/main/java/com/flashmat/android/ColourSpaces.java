package com.flashmat.android;

import android.annotation.TargetApi;
import android.graphics.Bitmap;
import android.graphics.ColorSpace;
import com.flashmat.Encoding;

/** What only API 26 and later know; loaded only there. */
@TargetApi(26)
final class ColourSpaces {
    private ColourSpaces() {}

    /** Encoding of a bitmap's values. */
    static Encoding encoding(Bitmap bitmap) {
        ColorSpace space = bitmap.getColorSpace();
        if (space == null || space.isSrgb()) {
            return Encoding.SRGB;
        }
        if (space.equals(ColorSpace.get(ColorSpace.Named.DISPLAY_P3))) {
            return Encoding.DISPLAY_P3;
        }
        if (space.equals(ColorSpace.get(ColorSpace.Named.LINEAR_SRGB))) {
            return Encoding.LINEAR;
        }
        throw new IllegalArgumentException(
                "colour space " + space.getName() + ": decode to sRGB (BitmapFactory.Options.inPreferredColorSpace)");
    }
}
