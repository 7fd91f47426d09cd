package com.flashmat;

import java.io.ByteArrayOutputStream;
import java.io.DataInputStream;
import java.io.IOException;
import java.io.InputStream;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;

/** The toy model and photos for it. */
final class Toy {
    static final int SIZE = 128;

    private Toy() {}

    /** A resource in a direct buffer. */
    static ByteBuffer resource(String name) {
        try (InputStream stream = Toy.class.getResourceAsStream("/" + name)) {
            if (stream == null) {
                throw new AssertionError("no resource " + name);
            }
            ByteArrayOutputStream bytes = new ByteArrayOutputStream();
            byte[] part = new byte[1 << 16];
            for (int read = stream.read(part); read >= 0; read = stream.read(part)) {
                bytes.write(part, 0, read);
            }
            return direct(bytes.toByteArray());
        } catch (IOException error) {
            throw new AssertionError(error);
        }
    }

    static ByteBuffer model() {
        return resource("toy.fmat");
    }

    static EngineOptions.Builder options() {
        return new EngineOptions.Builder().size(SIZE).threads(1);
    }

    static MaterialEngine engine() {
        return new MaterialEngine(model(), options().build());
    }

    static ByteBuffer direct(byte[] bytes) {
        ByteBuffer buffer = ByteBuffer.allocateDirect(bytes.length).order(ByteOrder.nativeOrder());
        buffer.put(bytes);
        buffer.flip();
        return buffer;
    }

    /** A photo with a bright middle, RGB. */
    static ByteBuffer photo(int size) {
        byte[] rgb = new byte[3 * size * size];
        for (int i = 0; i < rgb.length; i++) {
            float u = (float) (i / 3 % size) / size - 0.5f;
            float v = (float) (i / 3 / size) / size - 0.5f;
            float pattern = (i / 3 % size / 7 + i / 3 / size / 9 + i) % 3 / 3f;
            rgb[i] = (byte) (255 * (0.2f + 0.4f * pattern) * (1 - u * u - v * v));
        }
        return direct(rgb);
    }

    static Frame frame() {
        return Frame.rgb8(photo(100), 100, 100, 300).build();
    }

    /** What `examples/reference.rs` wrote. */
    static DataInputStream reference() {
        InputStream stream = Toy.class.getResourceAsStream("/reference.bin");
        if (stream == null) {
            throw new AssertionError("no reference.bin: run android/test-host.sh");
        }
        return new DataInputStream(new java.io.BufferedInputStream(stream, 1 << 20));
    }
}
