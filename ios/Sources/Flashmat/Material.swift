import FlashmatFFI

#if canImport(Darwin)
import Darwin
#elseif canImport(Glibc)
import Glibc
#endif

/// What a surface is made of.
public enum MaterialClass: UInt32, Sendable, CaseIterable {
    /// Woven and knitted cloth.
    case fabric = 1
    /// Soil, grass, gravel.
    case ground
    /// Leather.
    case leather
    /// Metal.
    case metal
    /// Diffuse stone.
    case stoneDiff
    /// Polished stone.
    case stoneSpec
    /// Plastics and paint.
    case polymer
    /// Wood.
    case wood

    /// The name that files and the other tools use, such as "stone-diff".
    public var name: String { String(cString: flashmat_class_name(rawValue)) }
}

/// The stages of a capture, in their order.
public enum CaptureStage: UInt32, Sendable, CaseIterable, Comparable {
    /// Photo to linear RGB at the maps' size.
    case frame
    /// The network: class probabilities and first maps.
    case global
    /// Where the flash is beside the camera.
    case flash
    /// Albedo below highlights.
    case highlight
    /// Refinement of the albedo.
    case albedo
    /// Texture of the albedo that a highlight burnt out.
    case texture
    /// Refinement of the normals.
    case normal
    /// Light scale and roughness search.
    case search
    /// Refinement of the roughness.
    case roughness
    /// Roughness below highlights.
    case level
    /// Re-render, lights and residual.
    case relight

    public static func < (a: Self, b: Self) -> Bool { a.rawValue < b.rawValue }

    /// The name that reports use, such as "albedo".
    public var name: String { String(cString: flashmat_stage_name(rawValue)) }
}

/// What a capture found beside the maps.
public struct MaterialReport: Sendable, Equatable {
    /// What one solver of the refinement did; zeros without refinement.
    public struct Solver: Sendable, Equatable {
        /// Steps taken.
        public let iterations: Int
        /// Relative residual where it stopped.
        public let residual: Float
    }

    /// The class: the caller's, or the most probable one.
    public let materialClass: MaterialClass
    /// What the network believes, in the order of ``MaterialClass/allCases``; the sum is 1.
    public let probabilities: [Float]
    /// The photo's exposure times the flash's strength: multiply a render with light strength 1 by it.
    public let lightScale: Float
    /// Even light that the re-render adds to the flash's, as a share of the flash's at the centre, in [0,1]: it adds
    /// `lightScale * roomLight * albedo`. Fitted with ``lightScale``, no measurement of the room.
    public let roomLight: Float
    /// Where the re-render's flash is, fitted to the photo, in plane units: the plane is z = 0, x to the right, y up, the camera
    /// at (0,0,1).
    public let flash: SIMD3<Float>
    /// Share of the photo's own pixels, within the square, that are overexposed in red, green and blue, 0 to 1.
    public let overexposed: SIMD3<Float>
    /// Mean linear light of what is not overexposed, 0 to 1.
    public let brightness: Float
    /// Whether so many pixels are overexposed that the maps suffer: take the photo with less exposure.
    public let isOverexposed: Bool
    /// Whether the photo is too dark for its 8 bits: take it nearer or with more exposure.
    public let isDark: Bool
    /// RMSE of the re-render against the photo, gamma 2.2, overexposed values left out.
    public let residual: Float
    /// Specular reflectance at normal incidence.
    public let f0: Float
    /// Field of view over the maps, in degrees.
    public let fieldOfView: Float
    /// Refinement of albedo, normal and roughness.
    public let solvers: [Solver]

    /// The probability of one class.
    public func probability(of material: MaterialClass) -> Float {
        probabilities[Int(material.rawValue) - 1]
    }

    init(_ report: flashmat_report) {
        materialClass = MaterialClass(rawValue: report.material_class) ?? .fabric
        probabilities = withUnsafeBytes(of: report.probabilities) { Array($0.bindMemory(to: Float.self)) }
        lightScale = report.light_scale
        roomLight = report.room_light
        flash = SIMD3(report.flash.0, report.flash.1, report.flash.2)
        overexposed = SIMD3(report.overexposed.0, report.overexposed.1, report.overexposed.2)
        brightness = report.brightness
        isOverexposed = report.photo_flags & UInt32(FLASHMAT_PHOTO_OVEREXPOSED) != 0
        isDark = report.photo_flags & UInt32(FLASHMAT_PHOTO_DARK) != 0
        residual = report.residual
        f0 = report.f0
        fieldOfView = report.fov_deg
        solvers = [report.solver.0, report.solver.1, report.solver.2].map {
            Solver(iterations: Int($0.iterations), residual: $0.residual)
        }
    }
}

/// A material: maps of `size` x `size` pixels, rows from the top, float planes one after the other.
///
/// Made by ``MaterialEngine``; save or share it as ``glb(name:)``, or show its maps as images.
public struct MaterialMaps: Sendable {
    /// One of the maps.
    public enum Map: Sendable, CaseIterable {
        /// Diffuse albedo (base colour).
        case albedo
        /// Normals.
        case normal
        /// Roughness.
        case roughness
        /// The maps re-rendered under the estimated flash, as bright as the photo.
        case render
        /// The photo as the network saw it.
        case photo
    }

    /// Pixels per side.
    public let size: Int
    /// 3 planes, linear light, sRGB primaries, 0...1.
    public let albedo: [Float]
    /// 3 planes x, y, z of unit vectors: x right, y up, z to the camera.
    public let normal: [Float]
    /// 1 plane, 0...1; alpha of GGX is its square.
    public let roughness: [Float]
    /// 3 planes, linear light.
    public let render: [Float]
    /// 3 planes, linear light.
    public let photo: [Float]
    /// Class, light, errors of fit.
    public let report: MaterialReport

    /// A map as 8-bit codes, interleaved RGB (roughness: grey): albedo, render and photo sRGB-encoded, normals as
    /// (n + 1) / 2, as image files have them.
    public func codes(of map: Map) -> [UInt8] {
        switch map {
        case .albedo: return interleaved(albedo, Self.srgb)
        case .normal: return interleaved(normal) { $0 * 0.5 + 0.5 }
        case .roughness: return roughness.map(Self.code)
        case .render: return interleaved(render, Self.srgb)
        case .photo: return interleaved(photo, Self.srgb)
        }
    }

    /// sRGB curve of a linear value.
    static func srgb(_ value: Float) -> Float {
        if value <= 0.003_130_8 { return max(0, value * 12.92) }
        return 1.055 * powf(min(1, value), 1 / 2.4) - 0.055
    }

    private func interleaved(_ planes: [Float], _ curve: (Float) -> Float) -> [UInt8] {
        let count = size * size
        var codes = [UInt8](repeating: 0, count: 3 * count)
        for channel in 0..<3 {
            for i in 0..<count {
                codes[3 * i + channel] = Self.code(curve(planes[channel * count + i]))
            }
        }
        return codes
    }

    private static func code(_ value: Float) -> UInt8 {
        // max gives 0 for NaN.
        UInt8(max(0, min(1, value)) * 255 + 0.5)
    }
}
