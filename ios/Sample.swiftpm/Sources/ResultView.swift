import Flashmat
import SceneKit
import SwiftUI

/// The material under a light that follows the finger, its maps, and a GLB to share.
struct ResultView: View {
    let result: CaptureResult
    @State private var light = CGPoint(x: 0.5, y: 0.5)
    @State private var file: URL?

    private var report: MaterialReport { result.maps.report }

    var body: some View {
        ScrollView {
            VStack(alignment: .leading, spacing: 16) {
                MaterialScene(maps: result.maps, light: light)
                    .aspectRatio(1, contentMode: .fit)
                    .clipShape(RoundedRectangle(cornerRadius: 12))
                    .gesture(drag)
                    .accessibilityLabel("The material; drag to move the light")
                Text("Drag to move the light").font(.caption).foregroundStyle(.secondary)
                HStack {
                    map("Albedo", .albedo)
                    map("Normal", .normal)
                    map("Roughness", .roughness)
                }
                Text(
                    "\(report.materialClass.name), \(Int(100 * report.probability(of: report.materialClass))) %"
                ).font(.headline)
                Text(String(format: "Re-render off by %.3f (gamma 2.2)", report.residual))
                    .font(.caption).foregroundStyle(.secondary)
            }
            .padding()
        }
        .navigationTitle("Material")
        .toolbar {
            if let file { ShareLink(item: file) }
        }
        .task { file = try? await write() }
    }

    private var drag: some Gesture {
        DragGesture(minimumDistance: 0).onChanged { value in
            // The scene is as wide as the screen, less its padding.
            let side = max(1, UIScreen.main.bounds.width - 32)
            light = CGPoint(
                x: min(max(value.location.x / side, 0), 1), y: min(max(value.location.y / side, 0), 1))
        }
    }

    private func map(_ name: String, _ map: MaterialMaps.Map) -> some View {
        VStack {
            if let image = result.maps.cgImage(map) {
                Image(decorative: image, scale: 1).resizable().aspectRatio(1, contentMode: .fit)
            }
            Text(name).font(.caption)
        }
    }

    private func write() async throws -> URL {
        let maps = result.maps
        return try await Task.detached {
            let url = FileManager.default.temporaryDirectory.appendingPathComponent("material.glb")
            try maps.glb(name: "Flashmat material").write(to: url, options: .atomic)
            return url
        }.value
    }
}

/// The maps on a square, lit by one lamp in front of it.
struct MaterialScene: UIViewRepresentable {
    let maps: MaterialMaps
    let light: CGPoint

    func makeUIView(context: Context) -> SCNView {
        let view = SCNView()
        let scene = SCNScene()
        let material = SCNMaterial()
        material.lightingModel = .physicallyBased
        material.diffuse.contents = maps.cgImage(.albedo)
        material.normal.contents = maps.cgImage(.normal)
        material.roughness.contents = maps.cgImage(.roughness)
        material.metalness.contents = maps.report.materialClass == .metal ? 1.0 : 0.0
        let plane = SCNPlane(width: 2, height: 2)
        plane.materials = [material]
        scene.rootNode.addChildNode(SCNNode(geometry: plane))
        let camera = SCNNode()
        camera.camera = SCNCamera()
        camera.camera?.usesOrthographicProjection = true
        camera.camera?.orthographicScale = 1
        camera.position = SCNVector3(0, 0, 3)
        scene.rootNode.addChildNode(camera)
        let lamp = SCNNode()
        lamp.name = "lamp"
        lamp.light = SCNLight()
        lamp.light?.type = .omni
        lamp.light?.intensity = 1200
        scene.rootNode.addChildNode(lamp)
        view.scene = scene
        view.pointOfView = camera
        view.backgroundColor = .black
        return view
    }

    func updateUIView(_ view: SCNView, context: Context) {
        let lamp = view.scene?.rootNode.childNode(withName: "lamp", recursively: false)
        lamp?.position = SCNVector3(Float(light.x) * 2 - 1, 1 - Float(light.y) * 2, 1)
    }
}
