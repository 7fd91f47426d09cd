package com.flashmat;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertNotNull;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.awt.image.BufferedImage;
import java.io.ByteArrayInputStream;
import java.io.ByteArrayOutputStream;
import java.io.IOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.charset.StandardCharsets;
import java.nio.file.Files;
import java.nio.file.Path;
import java.nio.file.Paths;
import java.util.regex.Matcher;
import java.util.regex.Pattern;
import javax.imageio.ImageIO;
import org.junit.jupiter.api.Test;

/** The GLB is well-formed and holds the maps; test-host.sh has Khronos' validator look at the file, too. */
final class GlbTest {
    /** The classifier does not take this photo for a metal; who took it says that it is one. */
    @Test
    void aClassThatTheCallerGaveCounts() throws IOException {
        MaterialMaps maps;
        try (MaterialEngine engine = Toy.engine()) {
            CaptureOptions options = new CaptureOptions.Builder().materialClass(MaterialClass.METAL).build();
            maps = engine.capture(Toy.frame(), options);
        }
        assertTrue(maps.probability(MaterialClass.METAL) < 0.5f);
        ByteArrayOutputStream out = new ByteArrayOutputStream();
        maps.writeGlb("metal", out);
        BufferedImage surface = pictures(out.toByteArray())[1];
        assertEquals(0xff, surface.getRGB(0, 0) & 0xff, "metallic");
    }

    /** The pictures of a file, in its order. */
    private static BufferedImage[] pictures(byte[] bytes) throws IOException {
        ByteBuffer file = ByteBuffer.wrap(bytes).order(ByteOrder.LITTLE_ENDIAN);
        byte[] text = new byte[file.getInt(12)];
        file.position(20);
        file.get(text);
        String json = new String(text, StandardCharsets.UTF_8);
        Matcher views = Pattern.compile("\"byteOffset\":(\\d+),\"byteLength\":(\\d+)").matcher(json);
        BufferedImage[] pictures = new BufferedImage[3];
        for (int i = 0; i < pictures.length; i++) {
            assertTrue(views.find());
            byte[] png = new byte[Integer.parseInt(views.group(2))];
            file.position(20 + text.length + 8 + Integer.parseInt(views.group(1)));
            file.get(png);
            pictures[i] = ImageIO.read(new ByteArrayInputStream(png));
            assertNotNull(pictures[i], "a PNG");
        }
        return pictures;
    }

    @Test
    void theFileHoldsTheMaps() throws IOException {
        MaterialMaps maps;
        try (MaterialEngine engine = Toy.engine()) {
            maps = engine.capture(Toy.frame());
        }
        ByteArrayOutputStream out = new ByteArrayOutputStream();
        maps.writeGlb("a \"toy\" \\ \u00fc\n\ud83e\udeb5", out);
        ByteBuffer file = ByteBuffer.wrap(out.toByteArray()).order(ByteOrder.LITTLE_ENDIAN);
        assertEquals(0x46546c67, file.getInt());
        assertEquals(2, file.getInt());
        assertEquals(file.capacity(), file.getInt());
        byte[] text = new byte[file.getInt()];
        assertEquals(0x4e4f534a, file.getInt());
        file.get(text);
        String json = new String(text, StandardCharsets.UTF_8);
        assertTrue(json.contains("\"a \\\"toy\\\" \\\\ \u00fc\\u000a\ud83e\udeb5\""), json);
        int length = file.getInt();
        assertEquals(0x004e4942, file.getInt());
        assertEquals(length, file.remaining());
        Picture[] order = {Picture.ALBEDO, Picture.ROUGHNESS, Picture.NORMAL};
        BufferedImage[] images = pictures(out.toByteArray());
        for (int number = 0; number < order.length; number++) {
            Picture picture = order[number];
            BufferedImage image = images[number];
            ByteBuffer expected = maps.encode(picture);
            for (int i = 0; i < Toy.SIZE * Toy.SIZE; i++) {
                int rgb = image.getRGB(i % Toy.SIZE, i / Toy.SIZE);
                assertEquals(expected.get(4 * i + 1) & 0xff, rgb >> 8 & 0xff, picture + " " + i);
                if (picture != Picture.ROUGHNESS) {
                    assertEquals(expected.get(4 * i) & 0xff, rgb >> 16 & 0xff, picture + " " + i);
                    assertEquals(expected.get(4 * i + 2) & 0xff, rgb & 0xff, picture + " " + i);
                }
            }
        }
        String keep = System.getProperty("com.flashmat.artefacts");
        if (keep != null) {
            Path path = Paths.get(keep, "toy.glb");
            Files.write(path, out.toByteArray());
        }
    }
}
