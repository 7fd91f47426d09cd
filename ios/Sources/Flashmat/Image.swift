#if canImport(CoreGraphics)
import CoreGraphics
import Foundation

extension Photo {
    /// A photo of an image, drawn into sRGB; nil if the system cannot draw it.
    ///
    /// Orientation is not applied: set ``rotation`` (or use an upright image).
    public init?(_ image: CGImage) {
        let (width, height) = (image.width, image.height)
        guard width > 0, height > 0, let space = CGColorSpace(name: CGColorSpace.sRGB) else { return nil }
        var data = Data(count: 4 * width * height)
        let drawn = data.withUnsafeMutableBytes { bytes -> Bool in
            let context = CGContext(
                data: bytes.baseAddress, width: width, height: height, bitsPerComponent: 8, bytesPerRow: 4 * width,
                space: space, bitmapInfo: CGImageAlphaInfo.noneSkipLast.rawValue)
            context?.draw(image, in: CGRect(x: 0, y: 0, width: width, height: height))
            return context != nil
        }
        guard drawn else { return nil }
        self.init(format: .rgba8, width: width, height: height, data: data)
    }
}

extension MaterialEngine {
    /// One image to material maps; as ``capture(_:options:progress:)``.
    ///
    /// - Throws: ``FlashmatError``; `CancellationError` if the task was cancelled.
    public func capture(
        image: CGImage, rotation: Photo.Rotation = .none, options: CaptureOptions = CaptureOptions(),
        progress: CaptureProgress? = nil
    ) async throws -> MaterialMaps {
        guard var photo = Photo(image) else {
            throw FlashmatError(code: .invalidArgument, message: "the image cannot be drawn into sRGB")
        }
        photo.rotation = rotation
        return try await capture(photo, options: options, progress: progress)
    }
}

extension MaterialMaps {
    /// A map as an image: colours in sRGB, normals and roughness as plain numbers.
    public func cgImage(_ map: Map) -> CGImage? {
        let grey = map == .roughness
        let bytes = codes(of: map)
        let isColour = map == .albedo || map == .render || map == .photo
        let name = isColour ? CGColorSpace.sRGB : CGColorSpace.linearSRGB
        let space = grey ? CGColorSpaceCreateDeviceGray() : CGColorSpace(name: name)
        guard let space, let provider = CGDataProvider(data: Data(bytes) as CFData) else { return nil }
        let channels = grey ? 1 : 3
        return CGImage(
            width: size, height: size, bitsPerComponent: 8, bitsPerPixel: 8 * channels, bytesPerRow: channels * size,
            space: space, bitmapInfo: CGBitmapInfo(rawValue: CGImageAlphaInfo.none.rawValue), provider: provider,
            decode: nil, shouldInterpolate: true, intent: .defaultIntent)
    }
}
#endif
