import FlashmatFFI
import Foundation

extension MaterialMaps {
    /// The material on a square, as one binary glTF 2.0 file for any viewer or engine: albedo, normals, roughness,
    /// metallic, index of refraction. The same bytes as the command line's `material.glb` of the same capture.
    ///
    /// - Throws: ``FlashmatError``.
    public func glb(name: String) throws -> Data {
        var file = Data()
        try albedo.withUnsafeBytes { albedo in
            try normal.withUnsafeBytes { normal in
                try roughness.withUnsafeBytes { roughness in
                    // The library only reads them here.
                    func buffer(_ bytes: UnsafeRawBufferPointer) -> flashmat_buffer {
                        flashmat_buffer(data: UnsafeMutableRawPointer(mutating: bytes.baseAddress), bytes: bytes.count)
                    }
                    var maps = flashmat_maps()
                    maps.struct_size = UInt32(MemoryLayout<flashmat_maps>.size)
                    // format 0: float planes.
                    maps.albedo = buffer(albedo)
                    maps.normal = buffer(normal)
                    maps.roughness = buffer(roughness)
                    var cReport = flashmat_report()
                    cReport.struct_size = UInt32(MemoryLayout<flashmat_report>.size)
                    cReport.f0 = report.f0
                    cReport.fov_deg = report.fieldOfView
                    let append: flashmat_write = { user, bytes, count in
                        guard let user, let bytes else { return 1 }
                        user.assumingMemoryBound(to: Data.self).pointee.append(
                            bytes.assumingMemoryBound(to: UInt8.self), count: count)
                        return 0
                    }
                    try withUnsafeMutablePointer(to: &file) { file in
                        try FlashmatError.check(
                            flashmat_export_glb(UInt32(size), &maps, &cReport, name, append, file))
                    }
                }
            }
        }
        return file
    }
}
