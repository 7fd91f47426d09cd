import Flashmat
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

    /// Starts the preview, or says why there is none.
    func startCamera() async {
        do { try await camera.start() } catch { say(error) }
    }

    /// Shows what went wrong.
    func say(_ error: Error) {
        message = (error as? FlashmatError)?.message ?? error.localizedDescription
    }

    /// Takes a photo with the torch on and makes a material of it.
    func takePhoto() {
        start { engine, progress in
            let shot = try await self.camera.takePhoto()
            var options = CaptureOptions()
            if let focal = shot.focal35mm { options.fieldOfView = .focal35mm(focal) }
            return try await engine.capture(
                pixelBuffer: shot.pixels, orientation: shot.orientation, options: options, progress: progress)
        }
    }

    /// Makes a material of a picture.
    func use(_ photo: PickedPhoto) {
        start { engine, progress in
            var options = CaptureOptions()
            if let focal = photo.focal35mm { options.fieldOfView = .focal35mm(focal) }
            return try await engine.capture(
                image: photo.image, rotation: photo.rotation, options: options, progress: progress)
        }
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
                // Not here: making it takes tens of milliseconds, in which no touch would be heard.
                if engine == nil { engine = try await Task.detached { try MaterialEngine() }.value }
                guard let engine else { return }
                result = CaptureResult(maps: try await capture(engine, steps))
            } catch is CancellationError {
                message = "Cancelled."
            } catch {
                say(error)
            }
        }
    }
}
