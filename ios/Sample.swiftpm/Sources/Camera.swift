import AVFoundation
import CoreVideo
import ImageIO

/// What the camera gave.
struct Shot: @unchecked Sendable {
    /// Full-range YUV, as the sensor lies.
    let pixels: CVPixelBuffer
    /// How it must be turned to stand upright, by how the phone was held.
    let orientation: CGImagePropertyOrientation
    /// 35 mm-equivalent focal length, if the camera tells.
    let focal35mm: Float?
}

/// The back camera with its torch: the light must be the flash, and where the camera is.
final class Camera: NSObject, @unchecked Sendable {
    let session = AVCaptureSession()
    private let output = AVCapturePhotoOutput()
    private let queue = DispatchQueue(label: "Camera")
    private var device: AVCaptureDevice?
    private var waiting: CheckedContinuation<Shot, Error>?

    enum Failure: LocalizedError {
        case notAllowed, noCamera, noPixels, busy
        var errorDescription: String? {
            switch self {
            case .notAllowed: return "Allow the camera in Settings."
            case .noCamera: return "No back camera; choose a picture instead."
            case .noPixels: return "The camera gave no picture."
            case .busy: return "A photo is being taken."
            }
        }
    }

    /// Asks for permission and starts the preview.
    func start() async throws {
        guard await AVCaptureDevice.requestAccess(for: .video) else { throw Failure.notAllowed }
        try await withCheckedThrowingContinuation { (done: CheckedContinuation<Void, Error>) in
            queue.async { done.resume(with: Result { try self.configure() }) }
        }
    }

    func stop() {
        queue.async {
            self.torch(false)
            self.session.stopRunning()
        }
    }

    /// One photo with the torch on.
    func takePhoto() async throws -> Shot {
        try await withCheckedThrowingContinuation { continuation in
            queue.async {
                guard self.waiting == nil else { return continuation.resume(throwing: Failure.busy) }
                guard self.device != nil else { return continuation.resume(throwing: Failure.noCamera) }
                self.waiting = continuation
                let settings = AVCapturePhotoSettings(format: [
                    kCVPixelBufferPixelFormatTypeKey as String: kCVPixelFormatType_420YpCbCr8BiPlanarFullRange
                ])
                settings.flashMode = self.output.supportedFlashModes.contains(.on) ? .on : .off
                self.output.capturePhoto(with: settings, delegate: self)
            }
        }
    }

    private func configure() throws {
        if device == nil {
            guard let camera = AVCaptureDevice.default(.builtInWideAngleCamera, for: .video, position: .back) else {
                throw Failure.noCamera
            }
            session.beginConfiguration()
            defer { session.commitConfiguration() }
            session.sessionPreset = .photo
            let input = try AVCaptureDeviceInput(device: camera)
            guard session.canAddInput(input), session.canAddOutput(output) else { throw Failure.noCamera }
            session.addInput(input)
            session.addOutput(output)
            device = camera
        }
        // The torch lets the camera meter and focus in the light of the photo.
        session.startRunning()
        torch(true)
    }

    private func torch(_ on: Bool) {
        guard let device, device.hasTorch, (try? device.lockForConfiguration()) != nil else { return }
        device.torchMode = on ? .on : .off
        device.unlockForConfiguration()
    }
}

extension Camera: AVCapturePhotoCaptureDelegate {
    func photoOutput(_ output: AVCapturePhotoOutput, didFinishProcessingPhoto photo: AVCapturePhoto, error: Error?) {
        let exif = photo.metadata[kCGImagePropertyExifDictionary as String] as? [String: Any]
        let focal = exif?[kCGImagePropertyExifFocalLenIn35mmFilm as String] as? NSNumber
        let result: Result<Shot, Error>
        if let error {
            result = .failure(error)
        } else if let pixels = photo.pixelBuffer {
            let turn = orientation(of: photo.metadata[kCGImagePropertyOrientation as String])
            result = .success(Shot(pixels: pixels, orientation: turn, focal35mm: focal?.floatValue))
        } else {
            result = .failure(Failure.noPixels)
        }
        queue.async {
            self.waiting?.resume(with: result)
            self.waiting = nil
        }
    }
}
