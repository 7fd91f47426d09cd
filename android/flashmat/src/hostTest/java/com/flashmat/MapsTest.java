package com.flashmat;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.nio.ByteBuffer;
import java.nio.FloatBuffer;
import org.junit.jupiter.api.AfterAll;
import org.junit.jupiter.api.BeforeAll;
import org.junit.jupiter.api.Test;

/** What maps say about themselves, and the pictures of them. */
final class MapsTest {
    private static final int PLANE = Toy.SIZE * Toy.SIZE;
    private static MaterialEngine engine;
    private static MaterialMaps maps;

    @BeforeAll
    static void capture() {
        engine = Toy.engine();
        maps = engine.capture(Toy.frame());
    }

    @AfterAll
    static void close() {
        engine.close();
    }

    @Test
    void theEngineDescribesItself() {
        assertEquals(Toy.SIZE, engine.size());
        assertTrue(engine.workspaceBytes() > 4L * 14 * PLANE);
        assertTrue(engine.modelMeta().startsWith("{"), engine.modelMeta());
        assertEquals(0x464d, MisuseTest.handle(engine) >>> 48, "tagged");
        assertTrue(MaterialEngine.version().matches("\\d+\\.\\d+\\.\\d+.*"));
        java.util.zip.CRC32 crc = new java.util.zip.CRC32();
        ByteBuffer model = Toy.model();
        model.position(64);
        crc.update(model);
        assertEquals(crc.getValue(), engine.modelChecksum(), "the checksum is of what follows the header");
        Level level = Level.valueOf(engine.level().toUpperCase(java.util.Locale.ROOT));
        assertTrue(level.number() >= 0);
    }

    @Test
    void numbersAreInTheirRanges() {
        float sum = 0;
        float best = 0;
        for (MaterialClass c : MaterialClass.values()) {
            sum += maps.probability(c);
            best = Math.max(best, maps.probability(c));
            assertEquals(c, MaterialClass.fromLabel(c.label()));
        }
        assertEquals(1, sum, 1e-5);
        assertEquals(best, maps.probability(maps.materialClass()));
        assertEquals(43.35f, maps.fieldOfView());
        assertTrue(maps.f0() >= 0.05f && maps.f0() <= 0.5f);
        assertTrue(maps.lightScale() > 0 && maps.residual() >= 0);
        assertTrue(maps.roomLight() >= 0 && maps.roomLight() <= 1);
        float[] flash = maps.flash();
        assertEquals(3, flash.length);
        assertTrue(Math.abs(flash[0]) <= 0.35f && Math.abs(flash[1]) <= 0.35f);
        assertEquals(1, flash[2]);
        float[] overexposed = maps.overexposed();
        assertEquals(3, overexposed.length);
        float most = Math.max(overexposed[0], Math.max(overexposed[1], overexposed[2]));
        assertEquals(most > Exposure.OVEREXPOSED, maps.isOverexposed());
        assertTrue(maps.brightness() > 0 && maps.brightness() <= 1);
        assertEquals(maps.brightness() < 0.01f, maps.isDark());
        assertEquals(3, maps.solverIterations().length);
        assertTrue(maps.solverIterations()[0] > 0 && maps.solverResiduals()[0] < 1);
    }

    @Test
    void planesAreWhereTheyBelong() {
        assertEquals(3 * PLANE, maps.albedo().remaining());
        assertEquals(PLANE, maps.roughness().remaining());
        FloatBuffer normal = maps.normal();
        for (int i = 0; i < PLANE; i++) {
            float x = normal.get(i);
            float y = normal.get(i + PLANE);
            float z = normal.get(i + 2 * PLANE);
            assertEquals(1, x * x + y * y + z * z, 1e-4);
        }
        FloatBuffer observability = maps.observability();
        for (int i = 0; i < PLANE; i++) {
            assertTrue(observability.get(i) >= 0 && observability.get(i) <= 1);
        }
    }

    private static int srgb(float linear) {
        double x = Math.min(Math.max(linear, 0), 1);
        double encoded = x <= 0.0031308 ? 12.92 * x : 1.055 * Math.pow(x, 1 / 2.4) - 0.055;
        return (int) Math.round(encoded * 255);
    }

    @Test
    void picturesAreTheMapsEncoded() {
        ByteBuffer albedo = maps.encode(Picture.ALBEDO);
        ByteBuffer normal = maps.encode(Picture.NORMAL);
        ByteBuffer roughness = maps.encode(Picture.ROUGHNESS);
        ByteBuffer render = maps.encode(Picture.RENDER);
        ByteBuffer photo = maps.encode(Picture.PHOTO);
        for (int i = 0; i < PLANE; i++) {
            for (int c = 0; c < 3; c++) {
                int at = 4 * i + c;
                assertEquals(srgb(maps.albedo().get(c * PLANE + i)), albedo.get(at) & 0xff, 1);
                assertEquals(srgb(maps.render().get(c * PLANE + i)), render.get(at) & 0xff, 1);
                assertEquals(srgb(maps.photo().get(c * PLANE + i)), photo.get(at) & 0xff, 1);
                long n = Math.round((maps.normal().get(c * PLANE + i) * 0.5 + 0.5) * 255);
                assertEquals(n, normal.get(at) & 0xff, 1);
                assertEquals(Math.round(maps.roughness().get(i) * 255.0), roughness.get(at) & 0xff, 1);
            }
            assertEquals(255, albedo.get(4 * i + 3) & 0xff);
        }
    }

    @Test
    void picturesGoToTheBuffersPosition() {
        ByteBuffer buffer = ByteBuffer.allocateDirect(4 * PLANE + 7);
        buffer.position(7);
        maps.encode(Picture.NORMAL, buffer);
        assertEquals(7, buffer.position());
        assertEquals(0, buffer.get(6));
        assertEquals(maps.encode(Picture.NORMAL).get(0), buffer.get(7));
        buffer.position(8);
        assertThrows(IllegalArgumentException.class, () -> maps.encode(Picture.NORMAL, buffer));
        ByteBuffer readOnly = ByteBuffer.allocateDirect(4 * PLANE).asReadOnlyBuffer();
        assertThrows(IllegalArgumentException.class, () -> maps.encode(Picture.NORMAL, readOnly));
    }

    @Test
    void optionsAreUsed() {
        CaptureOptions wood =
                new CaptureOptions.Builder().materialClass(MaterialClass.WOOD).refine(false).build();
        MaterialMaps other = engine.capture(Toy.frame(), wood);
        assertEquals(MaterialClass.WOOD, other.materialClass());
        assertEquals(0, other.solverIterations()[0]);
        CaptureOptions wide = new CaptureOptions.Builder().shorterSideFov(30).build();
        assertEquals(30, engine.capture(Toy.frame(), wide).fieldOfView(), 1e-4);
    }

    @Test
    void exposureCountsTheCentralSquare() {
        ByteBuffer luma = ByteBuffer.allocate(8 * 4);
        for (int y = 0; y < 4; y++) {
            for (int x = 0; x < 8; x++) {
                // Columns 0, 1 and 6, 7 lie outside; of the inner 16 pixels, 4 are clipped.
                luma.put((byte) (x < 2 || x > 5 ? 255 : x == 2 ? 254 : 253));
            }
        }
        luma.flip();
        assertEquals(0.25f, Exposure.clippedShare(luma, 8, 4, 8, 1, 1));
        assertEquals(0.5f, Exposure.clippedShare(luma, 8, 4, 8, 1, 2));
        assertThrows(IllegalArgumentException.class, () -> Exposure.clippedShare(luma, 8, 5, 8, 1, 1));
        assertThrows(IllegalArgumentException.class, () -> Exposure.clippedShare(luma, 8, 4, 8, 1, 0));
        int huge = Integer.MAX_VALUE;
        assertThrows(IllegalArgumentException.class, () -> Exposure.clippedShare(luma, huge, huge, huge, huge, 1));
    }
}
