import CoreGraphics
import Flashmat
import Foundation
import ImageIO

/// A picture from the library, with what its file says of how it was taken.
struct PickedPhoto: @unchecked Sendable {
    /// As stored, not turned.
    let image: CGImage
    /// The turn that makes it upright.
    let rotation: Photo.Rotation
    /// 35 mm-equivalent focal length, if the file tells.
    let focal35mm: Float?

    struct Unreadable: LocalizedError {
        var errorDescription: String? { "This file is no picture that the system can read; choose another." }
    }

    /// - Throws: ``Unreadable``; `FlashmatError` for mirrored pictures.
    init(_ data: Data) throws {
        guard let source = CGImageSourceCreateWithData(data as CFData, nil),
            let image = CGImageSourceCreateImageAtIndex(source, 0, nil)
        else { throw Unreadable() }
        let properties = CGImageSourceCopyPropertiesAtIndex(source, 0, nil) as? [CFString: Any] ?? [:]
        let exif = properties[kCGImagePropertyExifDictionary] as? [CFString: Any]
        self.image = image
        rotation = try Photo.Rotation(orientation(of: properties[kCGImagePropertyOrientation]))
        let focal = (exif?[kCGImagePropertyExifFocalLenIn35mmFilm] as? NSNumber)?.floatValue
        // 0 means unknown.
        focal35mm = focal.flatMap { $0 > 0 ? $0 : nil }
    }
}

/// An orientation as files and the camera write it; upright where they say nothing.
func orientation(of property: Any?) -> CGImagePropertyOrientation {
    (property as? NSNumber).flatMap { CGImagePropertyOrientation(rawValue: $0.uint32Value) } ?? .up
}
