package com.flashmat;

import static org.junit.jupiter.api.Assertions.assertArrayEquals;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.io.ByteArrayOutputStream;
import java.io.DataInputStream;
import java.io.IOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.FloatBuffer;
import java.util.ArrayList;
import java.util.List;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.TestFactory;

/** Every frame format gives the bits that the Rust API gives (`examples/reference.rs` calls core directly). */
final class FormatsTest {
    private static final int VALUES = 14 * Toy.SIZE * Toy.SIZE;

    /** One photo with what Rust made of it. */
    private static final class Case {
        String name;
        int[] layout = new int[11];
        ByteBuffer[] planes;
        CaptureOptions options;
        int[] numbers = new int[NativeBridge.NUMBERS];
        int[] values = new int[VALUES];
        byte[] glb;
    }

    private static Case read(DataInputStream in) throws IOException {
        Case c = new Case();
        c.name = in.readUTF();
        for (int i = 0; i < c.layout.length; i++) {
            c.layout[i] = in.readInt();
        }
        CaptureOptions.Builder options = new CaptureOptions.Builder();
        int kind = in.readInt();
        float fov = in.readFloat();
        if (kind == CaptureOptions.FOV_SHORTER_SIDE) {
            options.shorterSideFov(fov);
        } else if (kind == CaptureOptions.FOV_FOCAL) {
            options.focalLength35mm(fov);
        }
        options.targetFov(in.readFloat());
        options.lightScale(in.readFloat());
        int materialClass = in.readInt();
        options.materialClass(materialClass < 0 ? null : MaterialClass.of(materialClass));
        c.options = options.refine(in.readInt() == 1).build();
        c.planes = new ByteBuffer[in.readInt()];
        for (int i = 0; i < c.planes.length; i++) {
            byte[] bytes = new byte[in.readInt()];
            in.readFully(bytes);
            // Not at the buffer's start, and not to its end: position and limit count.
            ByteBuffer buffer = ByteBuffer.allocateDirect(bytes.length + 24).order(ByteOrder.nativeOrder());
            buffer.position(16);
            buffer.put(bytes);
            buffer.limit(16 + bytes.length);
            buffer.position(16);
            c.planes[i] = buffer;
        }
        for (int i = 0; i < c.numbers.length; i++) {
            c.numbers[i] = in.readInt();
        }
        for (int i = 0; i < c.values.length; i++) {
            c.values[i] = in.readInt();
        }
        c.glb = new byte[in.readInt()];
        in.readFully(c.glb);
        return c;
    }

    private static Frame frame(Case c) {
        int[] l = c.layout;
        ByteBuffer[] p = c.planes;
        Frame.Builder builder;
        switch (l[0]) {
            case 0:
                builder = Frame.rgb8(p[0], l[1], l[2], l[3]);
                break;
            case 1:
                builder = Frame.rgba8(p[0], l[1], l[2], l[3]);
                break;
            case 2:
                builder = Frame.bgra8(p[0], l[1], l[2], l[3]);
                break;
            case 3:
                builder = Frame.rgb16(p[0], l[1], l[2], l[3]);
                break;
            case 4:
                builder = Frame.rgbF32(p[0], l[1], l[2], l[3]);
                break;
            case 5:
                builder = Frame.nv12(p[0], l[3], p[1], l[5], l[1], l[2]);
                break;
            case 6:
                builder = Frame.nv21(p[0], l[3], p[1], l[5], l[1], l[2]);
                break;
            default:
                builder = Frame.yuv420(p[0], l[3], l[4], p[1], p[2], l[5], l[6], l[1], l[2]);
        }
        return builder.rotation(90 * l[7])
                .encoding(Encoding.values()[l[8]])
                .yuvColour(YuvMatrix.values()[l[9]], YuvRange.values()[l[10]])
                .build();
    }

    private static int[] bits(FloatBuffer... parts) {
        int[] bits = new int[VALUES];
        int at = 0;
        for (FloatBuffer part : parts) {
            while (part.hasRemaining()) {
                bits[at++] = Float.floatToRawIntBits(part.get());
            }
        }
        assertEquals(VALUES, at);
        return bits;
    }

    private static void check(MaterialEngine engine, Case c) throws IOException {
        MaterialMaps maps = engine.capture(frame(c), c.options);
        int[] numbers = new int[NativeBridge.NUMBERS];
        for (int i = 0; i < numbers.length; i++) {
            numbers[i] = Float.floatToRawIntBits(maps.numbers[i]);
        }
        assertArrayEquals(c.numbers, numbers, c.name + ": numbers");
        int[] values = bits(
                maps.albedo(), maps.normal(), maps.roughness(), maps.render(), maps.photo(), maps.observability());
        assertArrayEquals(c.values, values, c.name + ": planes");
        assertEquals(Float.floatToRawIntBits(maps.residual()), c.numbers[11]);
        ByteArrayOutputStream glb = new ByteArrayOutputStream();
        maps.writeGlb(c.name, glb);
        assertArrayEquals(c.glb, glb.toByteArray(), c.name + ": GLB");
    }

    @TestFactory
    Stream<DynamicTest> everyFormatIsEqualToTheRustApiBitForBit() throws IOException {
        List<Case> cases = new ArrayList<>();
        try (DataInputStream in = Toy.reference()) {
            byte[] magic = new byte[8];
            in.readFully(magic);
            assertEquals("FMREF002", new String(magic, "US-ASCII"));
            for (int left = in.readInt(); left > 0; left--) {
                cases.add(read(in));
            }
        }
        assertTrue(cases.stream().mapToInt(c -> c.layout[0]).distinct().count() == 8, "all eight formats");
        return cases.stream().map(c -> DynamicTest.dynamicTest(c.name, () -> {
            try (MaterialEngine engine = Toy.engine()) {
                check(engine, c);
            }
        }));
    }

    @TestFactory
    Stream<DynamicTest> neitherLevelNorThreadsChangeABit() throws IOException {
        Case first;
        try (DataInputStream in = Toy.reference()) {
            in.readFully(new byte[12]);
            first = read(in);
        }
        return Stream.of(
                        Toy.options().level(Level.SCALAR).build(),
                        Toy.options().threads(3).build(),
                        Toy.options().threads(0).build())
                .map(options -> DynamicTest.dynamicTest(options.level() + ", " + options.threads() + " threads", () -> {
                    try (MaterialEngine engine = new MaterialEngine(Toy.model(), options)) {
                        check(engine, first);
                    }
                }));
    }
}
