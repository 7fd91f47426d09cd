import FlashmatFFI
import Foundation

/// A photo as cameras and decoders give it: pixels of any layout, and what they mean.
public struct Photo: Sendable {
    /// How pixels lie in memory.
    public enum Format: UInt32, Sendable, CaseIterable {
        /// R, G, B, 8 bits each.
        case rgb8 = 1
        /// R, G, B, A, 8 bits each; A is not read.
        case rgba8
        /// B, G, R, A, 8 bits each; A is not read.
        case bgra8
        /// R, G, B, 16 bits each in native byte order.
        case rgb16
        /// R, G, B as `Float`, linear unless ``Photo/encoding`` says otherwise.
        case rgbF32
        /// Planes Y, then U and V interleaved (iOS cameras).
        case nv12
        /// Planes Y, then V and U interleaved.
        case nv21
        /// Planes Y, U, V.
        case yuv420
    }

    /// How the photo must be turned, clockwise, to stand upright.
    public enum Rotation: UInt32, Sendable, CaseIterable {
        /// Upright as it is.
        case none = 0
        /// A quarter turn clockwise.
        case clockwise90 = 90
        /// Half a turn.
        case half = 180
        /// A quarter turn counter-clockwise.
        case clockwise270 = 270
    }

    /// What the values of pixels mean.
    public enum Encoding: UInt32, Sendable, CaseIterable {
        /// sRGB; linear for ``Format/rgbF32``.
        case standard = 0
        /// sRGB curve and primaries.
        case sRGB
        /// Linear light, sRGB primaries.
        case linear
        /// sRGB curve, Display P3 primaries.
        case displayP3
    }

    /// Luma equation of YUV formats.
    public enum YUVMatrix: UInt32, Sendable, CaseIterable {
        /// BT.601 for YUV formats.
        case standard = 0
        /// BT.601.
        case bt601
        /// BT.709.
        case bt709
    }

    /// Which codes black and white have in YUV formats.
    public enum YUVRange: UInt32, Sendable, CaseIterable {
        /// Full for YUV formats.
        case standard = 0
        /// 0...255.
        case full
        /// 16...235.
        case limited
    }

    /// One plane of pixels.
    public struct Plane: Sendable {
        /// The bytes, from the first pixel on.
        public var data: Data
        /// Bytes from row to row; 0: no padding.
        public var rowStride: Int
        /// Bytes from pixel to pixel; 0: the format's own.
        public var pixelStride: Int

        /// A plane.
        public init(data: Data, rowStride: Int = 0, pixelStride: Int = 0) {
            self.data = data
            self.rowStride = rowStride
            self.pixelStride = pixelStride
        }
    }

    /// Layout of the pixels.
    public var format: Format
    /// Pixels across as stored, before the rotation.
    public var width: Int
    /// Pixels down as stored.
    public var height: Int
    /// As many planes as the format has.
    public var planes: [Plane]
    /// How to turn it.
    public var rotation: Rotation = .none
    /// What the values mean.
    public var encoding: Encoding = .standard
    /// For YUV formats.
    public var yuvMatrix: YUVMatrix = .standard
    /// For YUV formats.
    public var yuvRange: YUVRange = .standard

    /// A photo of several planes.
    public init(format: Format, width: Int, height: Int, planes: [Plane]) {
        self.format = format
        self.width = width
        self.height = height
        self.planes = planes
    }

    /// A photo of one plane.
    public init(format: Format, width: Int, height: Int, data: Data, rowStride: Int = 0) {
        self.init(format: format, width: width, height: height, planes: [Plane(data: data, rowStride: rowStride)])
    }
}

/// Pixels that can be lent to the library for the time of one call, on the thread that runs it.
protocol FrameSource: Sendable {
    func withFrame(_ body: (flashmat_frame) throws -> Void) throws
}

extension Photo: FrameSource {
    func withFrame(_ body: (flashmat_frame) throws -> Void) throws {
        guard planes.count <= 3, let width = UInt32(exactly: width), let height = UInt32(exactly: height) else {
            throw FlashmatError(code: .invalidArgument, message: "a photo has 1 to 3 planes and a positive size")
        }
        var frame = flashmat_frame()
        frame.struct_size = UInt32(MemoryLayout<flashmat_frame>.size)
        frame.format = format.rawValue
        frame.width = width
        frame.height = height
        frame.rotation = rotation.rawValue
        frame.encoding = encoding.rawValue
        frame.yuv_matrix = yuvMatrix.rawValue
        frame.yuv_range = yuvRange.rawValue
        try lend(planes[...], to: frame, body)
    }

    /// Adds the planes to the frame one inside the other, so that all bytes stay in place until `body` is done.
    private func lend(
        _ rest: ArraySlice<Plane>, to frame: flashmat_frame, _ body: (flashmat_frame) throws -> Void
    ) throws {
        guard let plane = rest.first else { return try body(frame) }
        guard plane.rowStride >= 0, plane.pixelStride >= 0 else {
            throw FlashmatError(code: .invalidArgument, message: "strides are not negative")
        }
        try plane.data.withUnsafeBytes { bytes in
            var frame = frame
            let described = flashmat_plane(
                data: bytes.baseAddress, bytes: bytes.count, row_stride: plane.rowStride,
                pixel_stride: plane.pixelStride)
            switch rest.startIndex {
            case 0: frame.planes.0 = described
            case 1: frame.planes.1 = described
            default: frame.planes.2 = described
            }
            try lend(rest.dropFirst(), to: frame, body)
        }
    }
}
