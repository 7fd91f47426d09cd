import AVFoundation
import PhotosUI
import SwiftUI

/// Preview with a framing guide, and the shutter.
struct CaptureView: View {
    @ObservedObject var model: CaptureModel
    @State private var picked: PhotosPickerItem?

    var body: some View {
        ZStack {
            Color.black.ignoresSafeArea()
            Preview(session: model.camera.session).ignoresSafeArea()
            FramingGuide()
            VStack {
                Text("Hold the phone flat over the surface, 20 to 50 cm away")
                    .font(.callout).padding(8).background(.ultraThinMaterial, in: Capsule())
                if let message = model.message {
                    Text(message).font(.callout).foregroundStyle(.yellow).padding(8)
                        .background(.black.opacity(0.6), in: RoundedRectangle(cornerRadius: 8))
                }
                Spacer()
                controls
            }
            .padding()
        }
        .task {
            await model.startCamera()
        }
        .onDisappear { model.camera.stop() }
        .onChange(of: picked) { item in
            Task {
                guard let item else { return }
                do {
                    guard let data = try await item.loadTransferable(type: Data.self) else { return }
                    model.use(try PickedPhoto(data))
                } catch {
                    model.say(error)
                }
            }
        }
    }

    @ViewBuilder private var controls: some View {
        if let progress = model.progress {
            HStack {
                ProgressView(value: progress).tint(.white)
                Button("Cancel", role: .cancel) { model.cancel() }
            }
            .padding().background(.ultraThinMaterial, in: RoundedRectangle(cornerRadius: 12))
        } else {
            HStack {
                PhotosPicker(selection: $picked, matching: .images) {
                    Image(systemName: "photo.on.rectangle").font(.title).frame(width: 64)
                }
                Spacer()
                Button {
                    model.takePhoto()
                } label: {
                    Circle().strokeBorder(.white, lineWidth: 4).background(Circle().fill(.white.opacity(0.3)))
                        .frame(width: 72, height: 72)
                }
                .accessibilityLabel("Take a flash photo")
                Spacer()
                Color.clear.frame(width: 64, height: 1)
            }
        }
    }
}

/// The square that is used, and its middle, where the flash's highlight should be.
struct FramingGuide: View {
    var body: some View {
        GeometryReader { geometry in
            let side = min(geometry.size.width, geometry.size.height) * 0.92
            ZStack {
                Rectangle().strokeBorder(.white.opacity(0.8), lineWidth: 2).frame(width: side, height: side)
                Circle().strokeBorder(.white.opacity(0.5), lineWidth: 1).frame(width: side / 6, height: side / 6)
            }
            .position(x: geometry.size.width / 2, y: geometry.size.height / 2)
        }
        .allowsHitTesting(false)
        .accessibilityHidden(true)
    }
}

/// The camera's picture.
struct Preview: UIViewRepresentable {
    let session: AVCaptureSession

    final class LayerView: UIView {
        override class var layerClass: AnyClass { AVCaptureVideoPreviewLayer.self }
    }

    func makeUIView(context: Context) -> LayerView {
        let view = LayerView()
        (view.layer as? AVCaptureVideoPreviewLayer)?.session = session
        (view.layer as? AVCaptureVideoPreviewLayer)?.videoGravity = .resizeAspectFill
        return view
    }

    func updateUIView(_ view: LayerView, context: Context) {}
}
