import FlashmatFFI
import Foundation

/// What an engine is made for.
public struct EngineOptions: Sendable {
    /// Pixels per side of the maps, a multiple of 128.
    public var size: Int = 256
    /// Threads to work with; 0: one per CPU. Results do not depend on it.
    public var threads: Int = 0
    /// A model file; nil: the one embedded in the library.
    public var model: Data?

    /// The defaults.
    public init() {}
}

/// What is known of a photo's field of view.
public enum PhotoFieldOfView: Sendable, Equatable {
    /// Nothing: the whole central square is used.
    case unknown
    /// The angle over the shorter side, in degrees.
    case shorterSide(Float)
    /// The focal length in mm, 35 mm equivalent (EXIF `FocalLengthIn35mmFilm`).
    case focal35mm(Float)
}

/// What a caller may choose for one capture.
public struct CaptureOptions: Sendable {
    /// The photo's field of view.
    public var fieldOfView: PhotoFieldOfView = .unknown
    /// The material's class, if you know better than the network.
    public var materialClass: MaterialClass?
    /// Linear value that a flat white surface at the centre has at this exposure under the flash alone, 0.001 to 1000,
    /// measured once with white paper; nil: the albedo's brightness is a guess.
    public var lightScale: Float?
    /// Whether the network's maps are refined.
    public var refine = true

    /// The defaults.
    public init() {}

    var cOptions: flashmat_capture_options {
        var options = flashmat_capture_options()
        options.struct_size = UInt32(MemoryLayout<flashmat_capture_options>.size)
        options.class_override = materialClass?.rawValue ?? 0
        options.skip_refinement = refine ? 0 : 1
        // 0 is "not known" to C; here it is refused as any other value out of range is.
        options.light_scale = lightScale.map { $0 == 0 ? -1 : $0 } ?? 0
        switch fieldOfView {
        case .unknown: break
        case .shorterSide(let degrees): options.photo_fov_deg = degrees
        case .focal35mm(let millimetres): options.focal_35mm = millimetres
        }
        return options
    }
}

/// Tells how far a capture is, as a stream of steps.
///
/// ```swift
/// let progress = CaptureProgress()
/// Task { for await step in progress.steps { bar.progress = step.overall } }
/// let maps = try await engine.capture(photo, progress: progress)
/// ```
/// The stream ends with the capture, whatever becomes of it. Use a new one for each capture.
public final class CaptureProgress: Sendable {
    /// A step of a capture.
    public struct Step: Sendable, Equatable {
        /// What is being done.
        public let stage: CaptureStage
        /// How much of the stage is done, 0...1.
        public let fraction: Float
        /// How much of all stages is done, 0...1, each stage counted the same.
        public var overall: Float {
            (Float(stage.rawValue) + fraction) / Float(CaptureStage.allCases.count)
        }
    }

    /// The steps; those that nobody fetched in time are dropped, but for the newest.
    public let steps: AsyncStream<Step>
    private let continuation: AsyncStream<Step>.Continuation

    /// A progress for one capture.
    public init() {
        var made: AsyncStream<Step>.Continuation?
        steps = AsyncStream(bufferingPolicy: .bufferingNewest(16)) { made = $0 }
        continuation = made!  // AsyncStream calls its closure before init returns.
    }

    func report(_ stage: UInt32, _ fraction: Float) {
        guard let stage = CaptureStage(rawValue: stage) else { return }
        continuation.yield(Step(stage: stage, fraction: fraction))
    }

    func finish() { continuation.finish() }
}
