import FlashmatFFI
import Foundation
import XCTest

@testable import Flashmat

final class CaptureTests: XCTestCase {
    func testMapsAreThoseOfTheCFunctions() async throws {
        let engine = try Support.engine()
        XCTAssertEqual(engine.size, Support.size)
        XCTAssertGreaterThan(engine.workspaceBytes, 1 << 20)
        XCTAssertFalse(engine.levelName.isEmpty)
        let maps = try await engine.capture(Support.photo())
        let plane = Support.size * Support.size
        XCTAssertEqual([maps.albedo, maps.normal, maps.roughness, maps.render, maps.photo].map(\.count), [3, 3, 1, 3, 3].map { $0 * plane })
        XCTAssertEqual(maps.report.probabilities.reduce(0, +), 1, accuracy: 1e-5)
        XCTAssertEqual(maps.report.solvers.count, 3)
        XCTAssertTrue(maps.report.solvers.allSatisfy { $0.iterations > 0 })

        // The same without an engine, by hand.
        let model = try Support.model()
        var pixels = Support.pixels()
        var albedo = [Float](repeating: 0, count: 3 * plane)
        var report = flashmat_report()
        report.struct_size = UInt32(MemoryLayout<flashmat_report>.size)
        let status = model.withUnsafeBytes { model in
            pixels.withUnsafeMutableBytes { pixels in
                albedo.withUnsafeMutableBytes { albedo in
                    var options = flashmat_engine_options()
                    options.struct_size = UInt32(MemoryLayout<flashmat_engine_options>.size)
                    options.size = UInt32(Support.size)
                    options.model = model.baseAddress
                    options.model_bytes = model.count
                    var bytes = 0
                    XCTAssertEqual(flashmat_workspace_bytes(&options, &bytes), 0)
                    let memory = UnsafeMutableRawPointer.allocate(byteCount: bytes, alignment: 64)
                    defer { memory.deallocate() }
                    var frame = flashmat_frame()
                    frame.struct_size = UInt32(MemoryLayout<flashmat_frame>.size)
                    frame.format = 1
                    frame.width = UInt32(Support.side)
                    frame.height = UInt32(Support.side)
                    frame.planes.0.data = UnsafeRawPointer(pixels.baseAddress)
                    frame.planes.0.bytes = pixels.count
                    var maps = flashmat_maps()
                    maps.struct_size = UInt32(MemoryLayout<flashmat_maps>.size)
                    maps.albedo = flashmat_buffer(data: albedo.baseAddress, bytes: albedo.count)
                    return flashmat_capture_in(&options, memory, bytes, &frame, nil, &maps, &report)
                }
            }
        }
        XCTAssertEqual(status, 0)
        XCTAssertEqual(albedo.map(\.bitPattern), maps.albedo.map(\.bitPattern))
        XCTAssertEqual(MaterialReport(report), maps.report)
    }

    func testOptionsAreHeard() async throws {
        let engine = try Support.engine()
        var options = Support.fast
        options.materialClass = .metal
        options.fieldOfView = .focal35mm(26)
        let maps = try await engine.capture(Support.photo(), options: options)
        XCTAssertEqual(maps.report.materialClass, .metal)
        XCTAssertEqual(maps.report.fieldOfView, 43.35, accuracy: 1e-3)
        XCTAssertTrue(maps.report.solvers.allSatisfy { $0.iterations == 0 })
    }

    func testPlanesAndRotation() async throws {
        let engine = try Support.engine()
        let side = Support.side
        let luma = Data((0..<side * side).map { UInt8(60 + $0 % side / 2) })
        let chroma = Data(repeating: 128, count: side * side / 2)
        var photo = Photo(
            format: .nv12, width: side, height: side, planes: [.init(data: luma), .init(data: chroma, rowStride: side)])
        photo.yuvMatrix = .bt709
        let upright = try await engine.capture(photo, options: Support.fast)
        photo.rotation = .half
        let turned = try await engine.capture(photo, options: Support.fast)
        XCTAssertEqual(upright.photo.prefix(Support.size * Support.size), ArraySlice(turned.photo.prefix(Support.size * Support.size).reversed()))
    }

    func testProgressIsAStreamThatEnds() async throws {
        let engine = try Support.engine()
        let progress = CaptureProgress()
        let listener = Task { () -> [CaptureProgress.Step] in
            var steps = [CaptureProgress.Step]()
            for await step in progress.steps { steps.append(step) }
            return steps
        }
        _ = try await engine.capture(Support.photo(), progress: progress)
        let steps = await listener.value
        XCTAssertFalse(steps.isEmpty)
        XCTAssertEqual(steps.last?.overall, 1)
        for (a, b) in zip(steps, steps.dropFirst()) { XCTAssertLessThanOrEqual(a.overall, b.overall) }
    }

    func testCapturesOfOneEngineQueue() async throws {
        let engine = try Support.engine()
        let all = try await withThrowingTaskGroup(of: MaterialMaps.self) { group in
            for _ in 0..<4 { group.addTask { try await engine.capture(Support.photo(), options: Support.fast) } }
            return try await group.reduce(into: []) { $0.append($1) }
        }
        XCTAssertEqual(all.count, 4)
        XCTAssertTrue(all.allSatisfy { $0.albedo == all[0].albedo })
    }

    func testCancelledBeforeAndDuring() async throws {
        let engine = try Support.engine()
        let before = Task { () -> Bool in
            withUnsafeCurrentTask { $0?.cancel() }
            do { _ = try await engine.capture(Support.photo()) } catch is CancellationError { return true }
            return false
        }
        let wasBefore = try await before.value
        XCTAssertTrue(wasBefore)
        let progress = CaptureProgress()
        let during = Task { () -> Bool in
            do { _ = try await engine.capture(Support.photo(), progress: progress) } catch is CancellationError { return true }
            return false
        }
        for await step in progress.steps where step.stage >= .global {
            during.cancel()
        }
        let wasDuring = try await during.value
        XCTAssertTrue(wasDuring)
        // And the engine is as good as new.
        _ = try await engine.capture(Support.photo(), options: Support.fast)
    }

    func testAnEngineMayGoWhileItsCaptureRuns() async throws {
        var engine: MaterialEngine? = try Support.engine()
        weak var gone = engine
        let task = Task { [engine] in try await engine!.capture(Support.photo(), options: Support.fast) }
        engine = nil
        let maps = try await task.value
        XCTAssertEqual(maps.size, Support.size)
        _ = gone
    }
}
