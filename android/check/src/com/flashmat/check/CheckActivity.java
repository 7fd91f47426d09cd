package com.flashmat.check;

import android.app.Activity;
import android.graphics.Bitmap;
import android.os.Bundle;
import android.widget.ImageView;
import com.flashmat.CaptureOptions;
import com.flashmat.EngineOptions;
import com.flashmat.Frame;
import com.flashmat.MaterialEngine;
import com.flashmat.MaterialMaps;
import com.flashmat.Picture;
import com.flashmat.android.Bitmaps;
import com.flashmat.android.BundledModel;
import com.flashmat.android.Frames;
import java.io.IOException;

/** The smallest app: what check-cross.sh compiles, packs and signs without Gradle. Shows a captured grey bitmap. */
public final class CheckActivity extends Activity {
    @Override
    protected void onCreate(Bundle state) {
        super.onCreate(state);
        Bitmap photo = Bitmap.createBitmap(128, 128, Bitmap.Config.ARGB_8888);
        photo.eraseColor(0xff808080);
        ImageView view = new ImageView(this);
        setContentView(view);
        EngineOptions options = new EngineOptions.Builder().size(128).build();
        try (MaterialEngine engine = new MaterialEngine(BundledModel.open(this), options)) {
            Frame frame = Frames.of(photo, 0);
            MaterialMaps maps = engine.capture(frame, CaptureOptions.DEFAULT);
            view.setImageBitmap(Bitmaps.of(maps, Picture.ALBEDO));
        } catch (IOException error) {
            throw new IllegalStateException(error);
        }
    }
}
