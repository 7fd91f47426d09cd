package com.flashmat.android;

import android.graphics.Bitmap;
import androidx.annotation.NonNull;
import com.flashmat.MaterialMaps;
import com.flashmat.Picture;
import java.util.Objects;

/** Captures as bitmaps. */
public final class Bitmaps {
    private Bitmaps() {}

    /** A picture of the maps, ARGB_8888. */
    @NonNull
    public static Bitmap of(@NonNull MaterialMaps maps, @NonNull Picture picture) {
        Objects.requireNonNull(maps, "maps");
        Bitmap bitmap = Bitmap.createBitmap(maps.size(), maps.size(), Bitmap.Config.ARGB_8888);
        bitmap.copyPixelsFromBuffer(maps.encode(picture));
        return bitmap;
    }
}
