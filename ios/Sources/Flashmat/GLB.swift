import Foundation

#if canImport(Darwin)
import Darwin
#elseif canImport(Glibc)
import Glibc
#endif

extension MaterialMaps {
    /// The material on a square, as one binary glTF 2.0 file for any viewer or engine.
    ///
    /// Metallic-roughness: base colour is the albedo, metallic is 1 for metals, else 0; `KHR_materials_ior` gives
    /// F0 = 0.05. The square faces +z; camera and flash stood at (0, 0, 1).
    public func glb(name: String) -> Data {
        let metallic: UInt8 = report.probability(of: .metal) >= 0.5 ? 255 : 0
        let surface: [UInt8] = codes(of: .roughness).flatMap { [255, $0, metallic] as [UInt8] }
        let images = [codes(of: .albedo), surface, codes(of: .normal)].map {
            PNG.file($0, width: size, height: size, channels: 3)
        }
        let half = Float(tan(Double(report.fieldOfView) * .pi / 360))
        let mesh = Self.square(half)
        var (bin, views) = (Data(), [String]())
        for part in images + mesh {
            bin.append(contentsOf: [UInt8](repeating: 0, count: (4 - bin.count % 4) % 4))
            views.append(#"{"buffer":0,"byteOffset":\#(bin.count),"byteLength":\#(part.count)}"#)
            bin.append(part)
        }
        bin.append(contentsOf: [UInt8](repeating: 0, count: (4 - bin.count % 4) % 4))
        let json = Self.scene(name: name, half: half, views: views, bytes: bin.count)
        return Self.container(Data(json.utf8), bin)
    }

    /// sRGB curve of a linear value.
    static func srgb(_ value: Float) -> Float {
        if value <= 0.003_130_8 { return max(0, value * 12.92) }
        return 1.055 * powf(min(1, value), 1 / 2.4) - 0.055
    }

    /// Positions, normals, texture coordinates, indices of a square in z = 0.
    private static func square(_ half: Float) -> [Data] {
        func floats(_ values: [Float]) -> Data {
            Data(values.flatMap { value in (0..<4).map { UInt8(value.bitPattern >> ($0 * 8) & 0xFF) } })
        }
        let positions = floats([-half, -half, 0, half, -half, 0, half, half, 0, -half, half, 0])
        let normals = floats([0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1])
        let coordinates = floats([0, 1, 1, 1, 1, 0, 0, 0])
        return [positions, normals, coordinates, Data([0, 0, 1, 0, 2, 0, 0, 0, 2, 0, 3, 0])]
    }

    private static func scene(name: String, half: Float, views: [String], bytes: Int) -> String {
        let title = quoted(name)
        return """
            {"asset":{"version":"2.0","generator":"Flashmat"},"extensionsUsed":["KHR_materials_ior"],\
            "scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"name":\(title)}],\
            "meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2},"indices":3,"material":0}]}],\
            "materials":[{"name":\(title),"pbrMetallicRoughness":{"baseColorTexture":{"index":0},\
            "metallicRoughnessTexture":{"index":1}},"normalTexture":{"index":2},\
            "extensions":{"KHR_materials_ior":{"ior":1.5760143}}}],\
            "textures":[{"source":0,"sampler":0},{"source":1,"sampler":0},{"source":2,"sampler":0}],\
            "samplers":[{"magFilter":9729,"minFilter":9987,"wrapS":33071,"wrapT":33071}],\
            "images":[{"bufferView":0,"mimeType":"image/png"},{"bufferView":1,"mimeType":"image/png"},\
            {"bufferView":2,"mimeType":"image/png"}],\
            "accessors":[{"bufferView":3,"componentType":5126,"count":4,"type":"VEC3",\
            "min":[\(-half),\(-half),0],"max":[\(half),\(half),0]},\
            {"bufferView":4,"componentType":5126,"count":4,"type":"VEC3"},\
            {"bufferView":5,"componentType":5126,"count":4,"type":"VEC2"},\
            {"bufferView":6,"componentType":5123,"count":6,"type":"SCALAR"}],\
            "bufferViews":[\(views.joined(separator: ","))],"buffers":[{"byteLength":\(bytes)}]}
            """
    }

    /// A JSON string.
    private static func quoted(_ text: String) -> String {
        let escaped = text.unicodeScalars.map { scalar -> String in
            switch scalar {
            case "\"", "\\": return "\\\(scalar)"
            case _ where scalar.value < 0x20: return "\\u00" + (scalar.value < 16 ? "0" : "") + String(scalar.value, radix: 16)
            default: return String(scalar)
            }
        }
        return "\"" + escaped.joined() + "\""
    }

    private static func container(_ json: Data, _ bin: Data) -> Data {
        let json = json + Data(repeating: 0x20, count: (4 - json.count % 4) % 4)
        func word(_ value: Int) -> Data { Data((0..<4).map { UInt8(value >> ($0 * 8) & 0xFF) }) }
        var file = Data("glTF".utf8) + word(2) + word(12 + 8 + json.count + 8 + bin.count)
        file += word(json.count) + Data("JSON".utf8) + json
        file += word(bin.count) + Data("BIN\0".utf8) + bin
        return file
    }
}
