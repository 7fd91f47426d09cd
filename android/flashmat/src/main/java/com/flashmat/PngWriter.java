package com.flashmat;

import java.io.ByteArrayOutputStream;
import java.nio.ByteBuffer;
import java.nio.charset.StandardCharsets;
import java.util.zip.CRC32;
import java.util.zip.Deflater;

/** PNG files of 8-bit RGB, for the pictures inside a GLB: the same bytes on every device. */
final class PngWriter {
    private static final byte[] SIGNATURE = {(byte) 0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    private static final int FILTER_SUB = 1;

    private PngWriter() {}

    /** A file; {@code rgb} holds 3 * size * size bytes, row by row from the top. */
    static byte[] encode(byte[] rgb, int size) {
        ByteArrayOutputStream out = new ByteArrayOutputStream(rgb.length / 2 + 1024);
        out.write(SIGNATURE, 0, SIGNATURE.length);
        ByteBuffer header = ByteBuffer.allocate(13).putInt(size).putInt(size);
        // 8 bits, RGB, deflate, adaptive filters, not interlaced.
        header.put((byte) 8).put((byte) 2).put((byte) 0).put((byte) 0).put((byte) 0);
        chunk(out, "IHDR", header.array(), 13);
        byte[] lines = filter(rgb, size);
        Deflater deflater = new Deflater();
        try {
            deflater.setInput(lines);
            deflater.finish();
            ByteArrayOutputStream packed = new ByteArrayOutputStream(rgb.length / 2);
            byte[] part = new byte[1 << 14];
            while (!deflater.finished()) {
                packed.write(part, 0, deflater.deflate(part));
            }
            chunk(out, "IDAT", packed.toByteArray(), packed.size());
        } finally {
            deflater.end();
        }
        chunk(out, "IEND", new byte[0], 0);
        return out.toByteArray();
    }

    /** Each row as differences to the pixel on the left, behind its filter's number. */
    private static byte[] filter(byte[] rgb, int size) {
        int row = 3 * size;
        byte[] lines = new byte[(row + 1) * size];
        for (int y = 0; y < size; y++) {
            int to = y * (row + 1);
            lines[to++] = FILTER_SUB;
            for (int x = 0; x < row; x++) {
                int left = x < 3 ? 0 : rgb[y * row + x - 3];
                lines[to++] = (byte) (rgb[y * row + x] - left);
            }
        }
        return lines;
    }

    private static void chunk(ByteArrayOutputStream out, String kind, byte[] data, int length) {
        byte[] name = kind.getBytes(StandardCharsets.US_ASCII);
        CRC32 crc = new CRC32();
        crc.update(name);
        crc.update(data, 0, length);
        number(out, length);
        out.write(name, 0, name.length);
        out.write(data, 0, length);
        number(out, (int) crc.getValue());
    }

    private static void number(ByteArrayOutputStream out, int value) {
        out.write(value >>> 24);
        out.write(value >>> 16);
        out.write(value >>> 8);
        out.write(value);
    }
}
