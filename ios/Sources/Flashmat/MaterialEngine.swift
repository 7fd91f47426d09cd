import Dispatch
import FlashmatFFI
import Foundation

/// Makes materials of flash photos: a model, threads and memory. Make one and keep it.
///
/// ```swift
/// let engine = try MaterialEngine()
/// let maps = try await engine.capture(pixelBuffer: buffer, orientation: .right)
/// try maps.glb(name: "brick").write(to: url)
/// ```
/// Captures of one engine run one after the other, on a thread of their own: no caller's thread is blocked. Cancelling
/// the task cancels its capture within milliseconds, before or while it runs.
public actor MaterialEngine {
    private nonisolated let handle: EngineHandle
    private nonisolated let queue = DispatchQueue(label: "Flashmat.MaterialEngine", qos: .userInitiated)

    /// Pixels per side of the maps.
    public nonisolated let size: Int
    /// Bytes that captures work in.
    public nonisolated let workspaceBytes: Int
    /// CRC-32 of the model file.
    public nonisolated let modelChecksum: UInt32
    /// Name of the instruction set in use, such as "neon".
    public nonisolated let levelName: String

    /// An engine; takes all its memory now.
    ///
    /// - Throws: ``FlashmatError``.
    public init(options: EngineOptions = EngineOptions()) throws {
        handle = try EngineHandle(options)
        let info = try handle.info()
        size = Int(info.size)
        workspaceBytes = Int(info.workspace_bytes)
        modelChecksum = info.model_checksum
        levelName = String(cString: flashmat_level_name(info.level))
    }

    /// One photo to material maps.
    ///
    /// - Throws: ``FlashmatError``; `CancellationError` if the task was cancelled.
    public func capture(
        _ photo: Photo, options: CaptureOptions = CaptureOptions(), progress: CaptureProgress? = nil
    ) async throws -> MaterialMaps {
        try await run(photo, options, progress)
    }

    /// Runs a capture on the engine's thread, behind those that came before.
    func run(
        _ source: any FrameSource, _ options: CaptureOptions, _ progress: CaptureProgress?
    ) async throws -> MaterialMaps {
        defer { progress?.finish() }
        let watch = Watch(progress)
        let (handle, size) = (handle, size)
        return try await withTaskCancellationHandler {
            try await withCheckedThrowingContinuation { continuation in
                queue.async {
                    continuation.resume(
                        with: Result { try handle.capture(source, size: size, options: options, watch: watch) })
                }
            }
        } onCancel: {
            watch.cancel()
        }
    }
}

/// Owns the C engine. The library lets one capture at a time use it; the queue sees to it that there is only one.
private final class EngineHandle: @unchecked Sendable {
    private let engine: OpaquePointer

    init(_ options: EngineOptions) throws {
        guard let size = UInt32(exactly: options.size), let threads = UInt32(exactly: options.threads) else {
            throw FlashmatError(code: .invalidArgument, message: "size and threads are not negative")
        }
        var cOptions = flashmat_engine_options()
        cOptions.struct_size = UInt32(MemoryLayout<flashmat_engine_options>.size)
        cOptions.size = size
        cOptions.threads = threads
        var made: OpaquePointer?
        if let model = options.model {
            try model.withUnsafeBytes { bytes in
                cOptions.model = bytes.baseAddress
                cOptions.model_bytes = bytes.count
                try FlashmatError.check(flashmat_engine_create(&cOptions, &made))
            }
        } else {
            try FlashmatError.check(flashmat_engine_create(&cOptions, &made))
        }
        guard let made else { throw FlashmatError(code: .internal, message: "no engine") }
        engine = made
    }

    deinit { flashmat_engine_destroy(engine) }

    func info() throws -> flashmat_engine_info {
        var info = flashmat_engine_info()
        info.struct_size = UInt32(MemoryLayout<flashmat_engine_info>.size)
        try FlashmatError.check(flashmat_engine_get_info(engine, &info))
        return info
    }

    func capture(
        _ source: any FrameSource, size: Int, options: CaptureOptions, watch: Watch
    ) throws -> MaterialMaps {
        // It may have waited in the queue.
        if watch.isCancelled { throw CancellationError() }
        var cOptions = options.cOptions
        cOptions.progress = { user, stage, fraction in
            guard let user else { return 0 }
            return Unmanaged<Watch>.fromOpaque(user).takeUnretainedValue().step(stage, fraction) ? 0 : 1
        }
        cOptions.user = Unmanaged.passUnretained(watch).toOpaque()
        var report = flashmat_report()
        report.struct_size = UInt32(MemoryLayout<flashmat_report>.size)
        let plane = size * size
        var planes = [Float](repeating: 0, count: 13 * plane)
        // `self` and `watch` live until the call is over, whatever the optimiser thinks.
        try withExtendedLifetime((self, watch)) {
            try source.withFrame { frame in
                var frame = frame
                try planes.withUnsafeMutableBytes { memory in
                    var maps = flashmat_maps()
                    maps.struct_size = UInt32(MemoryLayout<flashmat_maps>.size)
                    // format 0: float planes.
                    func buffer(_ first: Int, _ count: Int) -> flashmat_buffer {
                        flashmat_buffer(
                            data: memory.baseAddress.map { $0 + first * plane * 4 }, bytes: count * plane * 4)
                    }
                    maps.albedo = buffer(0, 3)
                    maps.normal = buffer(3, 3)
                    maps.roughness = buffer(6, 1)
                    maps.render = buffer(7, 3)
                    maps.photo = buffer(10, 3)
                    try FlashmatError.check(flashmat_capture(engine, &frame, &cOptions, &maps, &report))
                }
            }
        }
        func part(_ first: Int, _ count: Int) -> [Float] { Array(planes[first * plane..<(first + count) * plane]) }
        return MaterialMaps(
            size: size, albedo: part(0, 3), normal: part(3, 3), roughness: part(6, 1), render: part(7, 3),
            photo: part(10, 3), report: MaterialReport(report))
    }
}

/// Between a capture's thread and its task: progress out, cancellation in.
private final class Watch: @unchecked Sendable {
    private let lock = NSLock()
    private var cancelled = false
    private let progress: CaptureProgress?

    init(_ progress: CaptureProgress?) { self.progress = progress }

    var isCancelled: Bool {
        lock.lock()
        defer { lock.unlock() }
        return cancelled
    }

    func cancel() {
        lock.lock()
        defer { lock.unlock() }
        cancelled = true
    }

    /// Whether to go on.
    func step(_ stage: UInt32, _ fraction: Float) -> Bool {
        progress?.report(stage, fraction)
        return !isCancelled
    }
}
