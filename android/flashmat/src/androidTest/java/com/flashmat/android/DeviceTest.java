package com.flashmat.android;

import static org.junit.Assert.assertEquals;
import static org.junit.Assert.assertNotEquals;
import static org.junit.Assert.assertThrows;
import static org.junit.Assert.assertTrue;

import android.graphics.Bitmap;
import android.graphics.Color;
import androidx.test.ext.junit.runners.AndroidJUnit4;
import androidx.test.platform.app.InstrumentationRegistry;
import com.flashmat.EngineOptions;
import com.flashmat.FlashmatException;
import com.flashmat.Level;
import com.flashmat.MaterialEngine;
import com.flashmat.MaterialMaps;
import com.flashmat.Picture;
import java.io.IOException;
import org.junit.Test;
import org.junit.runner.RunWith;

/** What only a device can show: the packaged library and model, bitmaps, the phone's own CPU level. */
@RunWith(AndroidJUnit4.class)
public final class DeviceTest {
    private static MaterialEngine engine(Level level) throws IOException {
        EngineOptions options = new EngineOptions.Builder().size(128).level(level).build();
        return new MaterialEngine(
                BundledModel.open(InstrumentationRegistry.getInstrumentation().getTargetContext()), options);
    }

    private static Bitmap photo() {
        Bitmap photo = Bitmap.createBitmap(160, 140, Bitmap.Config.ARGB_8888);
        for (int y = 0; y < 140; y++) {
            for (int x = 0; x < 160; x++) {
                int glow = 200 - ((x - 80) * (x - 80) + (y - 70) * (y - 70)) / 80;
                photo.setPixel(x, y, Color.rgb(glow, glow * 3 / 4, x / 8 % 2 * 40 + glow / 2));
            }
        }
        return photo;
    }

    @Test
    public void aBitmapGivesTheSameMapsOnEveryLevel() throws IOException {
        try (MaterialEngine best = engine(Level.AUTO);
                MaterialEngine scalar = engine(Level.SCALAR)) {
            MaterialMaps maps = best.capture(Frames.of(photo(), 0));
            assertEquals(scalar.capture(Frames.of(photo(), 0)).albedo(), maps.albedo());
            Bitmap albedo = Bitmaps.of(maps, Picture.ALBEDO);
            assertEquals(128, albedo.getWidth());
            assertEquals(0xff, Color.alpha(albedo.getPixel(64, 64)));
            assertNotEquals("turned", maps.photo(), best.capture(Frames.of(photo(), 90)).photo());
        }
    }

    @Test
    public void aBlackBitmapIsAnErrorOfItsOwn() throws IOException {
        try (MaterialEngine engine = engine(Level.AUTO)) {
            Bitmap black = Bitmap.createBitmap(64, 64, Bitmap.Config.ARGB_8888);
            black.eraseColor(Color.BLACK);
            FlashmatException.BadPhoto error =
                    assertThrows(FlashmatException.BadPhoto.class, () -> engine.capture(Frames.of(black, 0)));
            assertTrue(error.getMessage().contains("black"));
        }
    }
}
