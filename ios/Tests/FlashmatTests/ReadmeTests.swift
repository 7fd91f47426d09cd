import Flashmat
import Foundation
import XCTest

/// The README's lines for Swift.
final class ReadmeTests: XCTestCase {
    private func albedo(model: Data?, rgb: Data, width: Int, height: Int) async throws -> [UInt8] {
        var engineOptions = EngineOptions()
        engineOptions.model = model  // nil: the model that the framework embeds
        let engine = try MaterialEngine(options: engineOptions)  // make one and keep it
        let photo = Photo(format: .rgb8, width: width, height: height, data: rgb)
        var options = CaptureOptions()
        options.fieldOfView = .focal35mm(26)
        let maps = try await engine.capture(photo, options: options)
        print(maps.report.materialClass.name, maps.report.residual)
        return maps.codes(of: .albedo)
    }

    func testLinesOfTheReadmeRun() async throws {
        let codes = try await albedo(
            model: Support.model(), rgb: Support.pixels(), width: Support.side, height: Support.side)
        XCTAssertEqual(codes.count, 3 * 256 * 256)
    }
}
