package com.flashmat;

import androidx.annotation.NonNull;
import java.io.ByteArrayOutputStream;
import java.io.IOException;
import java.io.OutputStream;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.charset.StandardCharsets;
import java.util.Locale;
import java.util.Objects;

/**
 * A captured material on a square, as one binary glTF 2.0 file for any viewer.
 *
 * <p>Metallic-roughness: base colour = albedo (sRGB), G = roughness, B = metallic (P(metal), rounded), normals as glTF
 * has them. {@code KHR_materials_ior} makes F0 = 0.05, where glTF alone has 0.04. The square lies in z = 0, faces +z
 * and has the size in which camera and flash stand at (0, 0, 1). The same file as the command line's, written anew.
 */
public final class GlbWriter {
    private static final int MAGIC = 0x46546c67;
    private static final int JSON = 0x4e4f534a;
    private static final int BIN = 0x004e4942;
    private static final int ARRAY_BUFFER = 34962;
    private static final int ELEMENT_ARRAY_BUFFER = 34963;

    private final ByteArrayOutputStream bin = new ByteArrayOutputStream();
    private final StringBuilder views = new StringBuilder();

    private GlbWriter() {}

    /** Writes the file; does not close {@code out}. */
    public static void write(@NonNull MaterialMaps maps, @NonNull String name, @NonNull OutputStream out)
            throws IOException {
        Objects.requireNonNull(maps, "maps");
        Objects.requireNonNull(name, "name");
        Objects.requireNonNull(out, "out");
        new GlbWriter().writeFile(maps, quoted(name), out);
    }

    private void writeFile(MaterialMaps maps, String name, OutputStream out) throws IOException {
        int size = maps.size();
        byte[] roughness = rgb(maps, Picture.ROUGHNESS);
        boolean metal = maps.probability(MaterialClass.METAL) >= 0.5f;
        for (int i = 0; i < roughness.length; i += 3) {
            // R is not read; full white keeps the picture usable as an occlusion map.
            roughness[i] = (byte) 0xff;
            roughness[i + 2] = (byte) (metal ? 0xff : 0);
        }
        view(PngWriter.encode(rgb(maps, Picture.ALBEDO), size), 0);
        view(PngWriter.encode(roughness, size), 0);
        view(PngWriter.encode(rgb(maps, Picture.NORMAL), size), 0);
        float half = (float) Math.tan(Math.toRadians(maps.fieldOfView()) / 2);
        // Top left, bottom left, bottom right, top right; texture rows run down.
        view(floats(-half, half, 0, -half, -half, 0, half, -half, 0, half, half, 0), ARRAY_BUFFER);
        view(floats(0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1), ARRAY_BUFFER);
        view(floats(1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1), ARRAY_BUFFER);
        view(floats(0, 0, 0, 1, 1, 1, 1, 0), ARRAY_BUFFER);
        view(new byte[] {0, 0, 1, 0, 2, 0, 0, 0, 2, 0, 3, 0}, ELEMENT_ARRAY_BUFFER);
        pad();
        container(json(name, half).getBytes(StandardCharsets.UTF_8), out);
    }

    /** A picture without its alpha. */
    private static byte[] rgb(MaterialMaps maps, Picture picture) {
        ByteBuffer rgba = maps.encode(picture);
        byte[] rgb = new byte[rgba.capacity() / 4 * 3];
        for (int from = 0, to = 0; to < rgb.length; from += 4, to += 3) {
            rgb[to] = rgba.get(from);
            rgb[to + 1] = rgba.get(from + 1);
            rgb[to + 2] = rgba.get(from + 2);
        }
        return rgb;
    }

    private static byte[] floats(float... values) {
        ByteBuffer bytes = ByteBuffer.allocate(4 * values.length).order(ByteOrder.LITTLE_ENDIAN);
        for (float value : values) {
            bytes.putFloat(value);
        }
        return bytes.array();
    }

    private void pad() {
        while (bin.size() % 4 != 0) {
            bin.write(0);
        }
    }

    /** Appends {@code data} on a 4-byte boundary and describes it; target 0: a picture. */
    private void view(byte[] data, int target) {
        pad();
        views.append(views.length() == 0 ? "" : ",");
        views.append("{\"buffer\":0,\"byteOffset\":").append(bin.size());
        views.append(",\"byteLength\":").append(data.length);
        views.append(target == 0 ? "" : ",\"target\":" + target).append('}');
        bin.write(data, 0, data.length);
    }

    private String json(String name, float half) {
        String bound = String.format(Locale.ROOT, "%.9g", half);
        String image = ",\"mimeType\":\"image/png\",\"name\":";
        String texture = "{\"sampler\":0,\"source\":";
        return "{\"asset\":{\"version\":\"2.0\",\"generator\":\"flashmat\"},"
                + "\"extensionsUsed\":[\"KHR_materials_ior\"],"
                + "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"name\":" + name + "}],"
                + "\"buffers\":[{\"byteLength\":" + bin.size() + "}],\"bufferViews\":[" + views + "],"
                + "\"images\":[{\"bufferView\":0" + image + "\"albedo\"},{\"bufferView\":1" + image
                + "\"metallic-roughness\"},{\"bufferView\":2" + image + "\"normal\"}],"
                // Linear with mipmaps, clamped to the edge.
                + "\"samplers\":[{\"magFilter\":9729,\"minFilter\":9987,\"wrapS\":33071,\"wrapT\":33071}],"
                + "\"textures\":[" + texture + "0}," + texture + "1}," + texture + "2}],"
                + "\"materials\":[{\"name\":" + name + ",\"pbrMetallicRoughness\":{\"baseColorTexture\":"
                + "{\"index\":0},\"metallicRoughnessTexture\":{\"index\":1}},\"normalTexture\":{\"index\":2},"
                // (1 + sqrt F0) / (1 - sqrt F0) with F0 = 0.05.
                + "\"extensions\":{\"KHR_materials_ior\":{\"ior\":1.5760143}}}],"
                + "\"accessors\":[{\"bufferView\":3,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\","
                + "\"min\":[-" + bound + ",-" + bound + ",0],\"max\":[" + bound + "," + bound + ",0]},"
                + accessor(4, "VEC3") + "," + accessor(5, "VEC4") + "," + accessor(6, "VEC2") + ","
                + "{\"bufferView\":7,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"}],"
                + "\"meshes\":[{\"name\":" + name + ",\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,"
                + "\"TANGENT\":2,\"TEXCOORD_0\":3},\"indices\":4,\"material\":0}]}]}";
    }

    private static String accessor(int view, String type) {
        return "{\"bufferView\":" + view + ",\"componentType\":5126,\"count\":4,\"type\":\"" + type + "\"}";
    }

    /** A JSON string. */
    private static String quoted(String text) {
        StringBuilder out = new StringBuilder("\"");
        for (int i = 0; i < text.length(); i++) {
            char c = text.charAt(i);
            if (c == '"' || c == '\\') {
                out.append('\\').append(c);
            } else if (c < 0x20 || Character.isSurrogate(c)) {
                out.append(String.format(Locale.ROOT, "\\u%04x", (int) c));
            } else {
                out.append(c);
            }
        }
        return out.append('"').toString();
    }

    private void container(byte[] json, OutputStream out) throws IOException {
        int jsonLength = (json.length + 3) / 4 * 4;
        ByteBuffer head = ByteBuffer.allocate(20 + jsonLength + 8).order(ByteOrder.LITTLE_ENDIAN);
        head.putInt(MAGIC).putInt(2).putInt(12 + 8 + jsonLength + 8 + bin.size());
        head.putInt(jsonLength).putInt(JSON).put(json);
        while (head.position() < 20 + jsonLength) {
            head.put((byte) ' ');
        }
        head.putInt(bin.size()).putInt(BIN);
        out.write(head.array());
        bin.writeTo(out);
    }
}
