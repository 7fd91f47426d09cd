import FlashmatFFI
import Foundation
import XCTest

@testable import Flashmat

final class ErrorTests: XCTestCase {
    func testEnginesThatCannotBe() async throws {
        var options = EngineOptions()
        options.model = Data("no model at all".utf8)
        await assertFails(.model, "not a Flashmat model") { try MaterialEngine(options: options) }
        options.model = try Support.model()
        options.size = 100
        await assertFails(.size, "100") { try MaterialEngine(options: options) }
        options.size = -1
        await assertFails(.invalidArgument) { try MaterialEngine(options: options) }
        options.size = 128
        options.threads = 1000
        await assertFails(.invalidArgument, "threads") { try MaterialEngine(options: options) }
    }

    func testPhotosThatCannotBe() async throws {
        let engine = try Support.engine()
        var photo = Support.photo()
        photo.width = 0
        await assertFails(.frameEmpty) { try await engine.capture(photo) }
        photo.width = -5
        await assertFails(.invalidArgument) { try await engine.capture(photo) }
        photo.width = Support.side + 1
        await assertFails(.frameBuffer, "too short") { try await engine.capture(photo) }
        photo = Support.photo()
        photo.planes[0].rowStride = 10
        await assertFails(.frameStride) { try await engine.capture(photo) }
        photo.planes[0].rowStride = -10
        await assertFails(.invalidArgument) { try await engine.capture(photo) }
        photo = Support.photo()
        photo.format = .nv12
        await assertFails(.nullPointer, "planes[1]") { try await engine.capture(photo) }
        photo.planes = Array(repeating: photo.planes[0], count: 4)
        await assertFails(.invalidArgument) { try await engine.capture(photo) }
        let black = Photo(format: .rgb8, width: 8, height: 8, data: Data(count: 192))
        await assertFails(.photoBlack) { try await engine.capture(black) }
        let white = Photo(format: .rgb8, width: 8, height: 8, data: Data(repeating: 255, count: 192))
        await assertFails(.noUsablePixels) { try await engine.capture(white) }
        var options = CaptureOptions()
        options.fieldOfView = .shorterSide(200)
        await assertFails(.fieldOfView) { try await engine.capture(Support.photo(), options: options) }
        for scale in [0, -1, 2000, Float.nan] {
            options = CaptureOptions()
            options.lightScale = scale
            await assertFails(.invalidArgument) { try await engine.capture(Support.photo(), options: options) }
        }
    }

    func testCodesAreThoseOfTheLibrary() {
        for code in FlashmatError.Code.allCases {
            // FLASHMAT_STATUS_FRAME_TOO_LARGE -> frameTooLarge
            let name = String(cString: flashmat_status_name(code.rawValue)).dropFirst("FLASHMAT_STATUS_".count)
            let words = name.lowercased().split(separator: "_").map(String.init)
            let camel = words.first.map { $0 + words.dropFirst().map(\.capitalized).joined() }
            XCTAssertEqual(camel, "\(code)")
        }
        XCTAssertEqual(String(cString: flashmat_status_name(Int32(FlashmatError.Code.allCases.count + 1))), "")
        XCTAssertEqual(
            MaterialClass.allCases.map(\.name),
            ["fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood"])
        XCTAssertEqual(
            CaptureStage.allCases.map(\.name),
            [
                "frame", "global", "flash", "highlight", "albedo", "texture", "normal", "search", "roughness", "level",
                "relight",
            ])
    }
}
