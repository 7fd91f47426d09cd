package com.flashmat.android;

import android.content.Context;
import android.content.res.AssetFileDescriptor;
import androidx.annotation.NonNull;
import java.io.ByteArrayOutputStream;
import java.io.FileInputStream;
import java.io.IOException;
import java.io.InputStream;
import java.nio.ByteBuffer;
import java.nio.channels.FileChannel;
import java.util.Objects;

/** The model that the library brings along, as an asset. */
public final class BundledModel {
    /** Its name among the app's assets. */
    public static final String ASSET = "flashmat/phone.fmat";

    private BundledModel() {}

    /**
     * The model's bytes in a direct buffer, for {@code new MaterialEngine(model, options)}: mapped when the app stores
     * the asset uncompressed ({@code androidResources.noCompress += "fmat"}), else unpacked.
     */
    @NonNull
    public static ByteBuffer open(@NonNull Context context) throws IOException {
        Objects.requireNonNull(context, "context");
        try (AssetFileDescriptor asset = context.getAssets().openFd(ASSET);
                // Not createInputStream(): from API 34 on its channel cannot be mapped.
                FileInputStream stream = new FileInputStream(asset.getFileDescriptor())) {
            return stream.getChannel()
                    .map(FileChannel.MapMode.READ_ONLY, asset.getStartOffset(), asset.getDeclaredLength());
        } catch (IOException compressed) {
            return unpack(context);
        }
    }

    private static ByteBuffer unpack(Context context) throws IOException {
        try (InputStream stream = context.getAssets().open(ASSET)) {
            ByteArrayOutputStream bytes = new ByteArrayOutputStream(1 << 23);
            byte[] part = new byte[1 << 16];
            for (int read = stream.read(part); read >= 0; read = stream.read(part)) {
                bytes.write(part, 0, read);
            }
            ByteBuffer model = ByteBuffer.allocateDirect(bytes.size());
            model.put(bytes.toByteArray());
            model.flip();
            return model;
        }
    }
}
