import Foundation
import XCTest

@testable import Flashmat

final class ExportTests: XCTestCase {
    func testSRGBCurve() {
        XCTAssertEqual(MaterialMaps.srgb(0.214_041_14), 0.5, accuracy: 1e-5)
        XCTAssertEqual(MaterialMaps.srgb(0.002), 0.025_84, accuracy: 1e-6)
        for (linear, encoded) in [(-1, 0), (0, 0), (1, 1), (2, 1)] as [(Float, Float)] {
            XCTAssertEqual(MaterialMaps.srgb(linear), encoded, accuracy: 1e-6)
        }
    }

    func testGLBHoldsTheMaps() async throws {
        let engine = try Support.engine()
        var options = Support.fast
        options.materialClass = .wood
        let maps = try await engine.capture(Support.photo(), options: options)
        let file = try maps.glb(name: "a \"brick\"\n")
        if let path = ProcessInfo.processInfo.environment["FLASHMAT_WRITE_GLB"] {
            try file.write(to: URL(fileURLWithPath: path))
        }
        func word(_ at: Int) -> Int { (0..<4).reduce(0) { $0 | Int(file[at + $1]) << (8 * $1) } }
        XCTAssertEqual(file.prefix(4), Data("glTF".utf8))
        XCTAssertEqual([word(4), word(8)], [2, file.count])
        let json = word(12)
        XCTAssertEqual(json % 4, 0)
        let scene = try XCTUnwrap(JSONSerialization.jsonObject(with: file[20..<20 + json]) as? [String: Any])
        XCTAssertEqual((scene["nodes"] as? [[String: Any]])?.first?["name"] as? String, "a \"brick\"\n")
        let bin = 20 + json + 8
        XCTAssertEqual(bin + word(20 + json), file.count)
        let views = try XCTUnwrap(scene["bufferViews"] as? [[String: Int]])
        XCTAssertEqual(views.count, 8)
        // The first picture is the albedo: a PNG of the maps' size.
        let start = bin + (views[0]["byteOffset"] ?? 0)
        let png = Array(file[start..<start + (views[0]["byteLength"] ?? 0)])
        XCTAssertEqual(Array(png.prefix(8)), [0x89, 0x50, 0x4E, 0x47, 13, 10, 26, 10])
        XCTAssertEqual(Array(png[16..<24]), [0, 0, 0, 128, 0, 0, 0, 128])
    }

    /// A class that the caller gave counts: the metal's file differs from the classifier's in what metallic says, and a
    /// metal's index of refraction is that of F0 = 0.05.
    func testGLBHonoursTheClass() async throws {
        let engine = try Support.engine()
        var options = Support.fast
        options.materialClass = .metal
        let metal = try await engine.capture(Support.photo(), options: options)
        XCTAssertEqual(metal.report.f0, 0.5, accuracy: 1e-6)
        XCTAssertLessThan(metal.report.probability(of: .metal), 0.5)
        let file = try metal.glb(name: "metal")
        XCTAssertNotNil(file.range(of: Data(#""ior":1.5760144"#.utf8)))
        // White, grey, white: what a decoder sees is checked in Rust (export/tests), the same bytes here.
        XCTAssertEqual(file, try metal.glb(name: "metal"))
    }

    func testCodes() async throws {
        let engine = try Support.engine()
        let maps = try await engine.capture(Support.photo(), options: Support.fast)
        let count = Support.size * Support.size
        for map in MaterialMaps.Map.allCases {
            XCTAssertEqual(maps.codes(of: map).count, map == .roughness ? count : 3 * count)
        }
        // A flat normal is (128, 128, 255); all of them point to the camera.
        let normal = maps.codes(of: .normal)
        XCTAssertTrue(stride(from: 2, to: normal.count, by: 3).allSatisfy { normal[$0] >= 128 })
    }
}
