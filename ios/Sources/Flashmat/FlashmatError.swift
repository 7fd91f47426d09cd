import FlashmatFFI

/// Why a capture, or an engine, could not be had.
///
/// A cancelled capture throws `CancellationError` instead.
public struct FlashmatError: Error, Sendable, Equatable, CustomStringConvertible {
    /// The cause as a number that never changes its meaning. `verify-codes.sh` compares the cases with the C header.
    public enum Code: Int32, Sendable, CaseIterable {
        /// A pointer that must be given is NULL.
        case nullPointer = 1
        /// A struct's size is none that the library knows: library and package do not fit together.
        case structSize = 2
        /// A number is not one of its enumeration.
        case unknownValue = 3
        /// Arguments that contradict each other or are out of range.
        case invalidArgument = 4
        /// Pixels are not aligned to their type.
        case misaligned = 5
        /// An output buffer is too small.
        case bufferTooSmall = 6
        /// Another capture is running on the engine. ``MaterialEngine`` queues them, so it never throws this.
        case busy = 7
        /// Nothing is running that could be cancelled.
        case idle = 8
        /// The capture was cancelled. ``MaterialEngine`` throws `CancellationError` for it.
        case cancelled = 9
        /// The memory cannot be had.
        case outOfMemory = 10
        /// A bug in the library; it was caught.
        case `internal` = 11
        /// An earlier capture ended with a bug: make another engine.
        case poisoned = 12
        /// No model was given and the library embeds none.
        case noModel = 13
        /// The bytes are not a model that the library can run.
        case model = 14
        /// The size of the maps does not suit the network.
        case size = 15
        /// This CPU or this build does not have the level asked for.
        case level = 16
        /// The system gave no threads.
        case threads = 17
        /// The photo has no pixels.
        case frameEmpty = 18
        /// The photo is too large.
        case frameTooLarge = 19
        /// A stride of the photo is too small.
        case frameStride = 20
        /// The photo's buffer ends before its last pixel.
        case frameBuffer = 21
        /// A float pixel is NaN, infinite or negative.
        case framePixel = 22
        /// A field of view or focal length makes no sense.
        case fieldOfView = 23
        /// The photo is overexposed all over.
        case noUsablePixels = 24
        /// The photo is black.
        case photoBlack = 25
        /// The workspace is too small.
        case workspaceTooSmall = 26
    }

    /// The cause.
    public let code: Code
    /// One sentence in English with the details.
    public let message: String

    /// An error of this package.
    public init(code: Code, message: String) {
        self.code = code
        self.message = message
    }

    /// The code's number and the message.
    public var description: String { "\(message) (Flashmat error \(code.rawValue))" }

    /// Throws what a status (`number`) says of the last call of this thread.
    static func check(_ number: Int32) throws {
        if number == 0 { return }
        if number == Code.cancelled.rawValue { throw CancellationError() }
        let message = String(cString: flashmat_last_error())
        // A library newer than this package may know more codes.
        throw FlashmatError(code: Code(rawValue: number) ?? .internal, message: message)
    }
}
