import CoreVideo
import Flashmat
import ImageIO
import SwiftUI

/// A finished capture.
struct CaptureResult: Identifiable {
    let id = UUID()
    let maps: MaterialMaps
}

/// Between camera, engine and views.
@MainActor
final class CaptureModel: ObservableObject {
    @Published var result: CaptureResult?
    @Published private(set) var progress: Float?
    @Published private(set) var message: String?

    let camera = Camera()
    private var engine: MaterialEngine?
    private var task: Task<Void, Never>?

    /// Takes a photo with the torch on and makes a material of it.
    func takePhoto() {
        start { engine, progress in
            let shot = try await self.camera.takePhoto()
            var options = CaptureOptions()
            if let focal = shot.focal35mm { options.fieldOfView = .focal35mm(focal) }
            return try await engine.capture(
                pixelBuffer: shot.pixels, orientation: .right, options: options, progress: progress)
        }
    }

    /// Makes a material of a picture.
    func use(_ image: CGImage) {
        start { engine, progress in try await engine.capture(image: image, progress: progress) }
    }

    func cancel() { task?.cancel() }

    private func start(_ capture: @escaping (MaterialEngine, CaptureProgress) async throws -> MaterialMaps) {
        guard task == nil else { return }
        message = nil
        progress = 0
        task = Task {
            defer {
                task = nil
                progress = nil
            }
            let steps = CaptureProgress()
            let listener = Task { for await step in steps.steps { progress = step.overall } }
            defer { listener.cancel() }
            do {
                let engine = try self.engine ?? MaterialEngine()
                self.engine = engine
                result = CaptureResult(maps: try await capture(engine, steps))
            } catch is CancellationError {
                message = "Cancelled."
            } catch let error as FlashmatError {
                message = error.message
            } catch {
                message = error.localizedDescription
            }
        }
    }
}
