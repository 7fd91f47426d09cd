#if canImport(CoreVideo) && canImport(ImageIO)
import CoreVideo
import FlashmatFFI
import ImageIO

extension MaterialEngine {
    /// One camera frame to material maps. The buffer is locked while its capture runs, and not copied.
    ///
    /// Formats: 420f, 420v (full and video range), BGRA, RGBA. Matrix and primaries are read from the buffer's
    /// attachments.
    /// - Parameter orientation: as the camera delivers it (portrait, back camera: `.right`). Mirrored ones are refused.
    /// - Throws: ``FlashmatError``; `CancellationError` if the task was cancelled.
    public func capture(
        pixelBuffer: CVPixelBuffer, orientation: CGImagePropertyOrientation = .up,
        options: CaptureOptions = CaptureOptions(), progress: CaptureProgress? = nil
    ) async throws -> MaterialMaps {
        let source = PixelBufferSource(buffer: pixelBuffer, rotation: try Photo.Rotation(orientation))
        return try await run(source, options, progress)
    }
}

extension Photo.Rotation {
    /// The turn that an EXIF orientation asks for.
    ///
    /// - Throws: ``FlashmatError`` for mirrored orientations: a mirrored material has wrong normals.
    public init(_ orientation: CGImagePropertyOrientation) throws {
        switch orientation {
        case .up: self = .none
        case .right: self = .clockwise90
        case .down: self = .half
        case .left: self = .clockwise270
        default:
            throw FlashmatError(code: .invalidArgument, message: "mirrored photos are not supported; use the back camera")
        }
    }
}

/// A pixel buffer, locked for the time of the call alone. Its owner must not write to it meanwhile.
private struct PixelBufferSource: FrameSource, @unchecked Sendable {
    let buffer: CVPixelBuffer
    let rotation: Photo.Rotation

    func withFrame(_ body: (flashmat_frame) throws -> Void) throws {
        guard CVPixelBufferLockBaseAddress(buffer, .readOnly) == kCVReturnSuccess else {
            throw FlashmatError(code: .invalidArgument, message: "the pixel buffer cannot be locked")
        }
        defer { CVPixelBufferUnlockBaseAddress(buffer, .readOnly) }
        var frame = flashmat_frame()
        frame.struct_size = UInt32(MemoryLayout<flashmat_frame>.size)
        frame.width = UInt32(CVPixelBufferGetWidth(buffer))
        frame.height = UInt32(CVPixelBufferGetHeight(buffer))
        frame.rotation = rotation.rawValue
        if attachment(kCVImageBufferColorPrimariesKey) == kCVImageBufferColorPrimaries_P3_D65 as String {
            frame.encoding = Photo.Encoding.displayP3.rawValue
        }
        let type = CVPixelBufferGetPixelFormatType(buffer)
        switch type {
        case kCVPixelFormatType_420YpCbCr8BiPlanarFullRange, kCVPixelFormatType_420YpCbCr8BiPlanarVideoRange:
            let full = type == kCVPixelFormatType_420YpCbCr8BiPlanarFullRange
            let is601 = attachment(kCVImageBufferYCbCrMatrixKey) == kCVImageBufferYCbCrMatrix_ITU_R_601_4 as String
            frame.format = Photo.Format.nv12.rawValue
            frame.yuv_range = (full ? Photo.YUVRange.full : .limited).rawValue
            frame.yuv_matrix = (is601 ? Photo.YUVMatrix.bt601 : .bt709).rawValue
            frame.planes.0 = plane(0)
            frame.planes.1 = plane(1)
        case kCVPixelFormatType_32BGRA, kCVPixelFormatType_32RGBA:
            let bgra = type == kCVPixelFormatType_32BGRA
            frame.format = (bgra ? Photo.Format.bgra8 : .rgba8).rawValue
            let row = CVPixelBufferGetBytesPerRow(buffer)
            frame.planes.0 = flashmat_plane(
                data: CVPixelBufferGetBaseAddress(buffer), bytes: row * CVPixelBufferGetHeight(buffer),
                row_stride: row, pixel_stride: 0)
        default:
            throw FlashmatError(code: .invalidArgument, message: "pixel format \(type) is not supported; ask for 420f")
        }
        try body(frame)
    }

    private func plane(_ index: Int) -> flashmat_plane {
        let row = CVPixelBufferGetBytesPerRowOfPlane(buffer, index)
        return flashmat_plane(
            data: CVPixelBufferGetBaseAddressOfPlane(buffer, index),
            bytes: row * CVPixelBufferGetHeightOfPlane(buffer, index), row_stride: row, pixel_stride: 0)
    }

    private func attachment(_ key: CFString) -> String? {
        CVBufferCopyAttachment(buffer, key, nil) as? String
    }
}
#endif
