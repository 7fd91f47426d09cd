import Flashmat
import Foundation
import XCTest

/// What the tests share: the toy model of the project's golden files, and a photo of a checked surface under a flash.
enum Support {
    static let size = 128
    static let side = 140

    static func model() throws -> Data {
        // ios/Tests/FlashmatTests -> the project; or where the environment says.
        let root = ProcessInfo.processInfo.environment["FLASHMAT_ROOT"].map(URL.init(fileURLWithPath:))
            ?? URL(fileURLWithPath: #filePath).appendingPathComponent("../../../..").standardizedFileURL
        return try Data(contentsOf: root.appendingPathComponent("tests/golden/toy.fmat"))
    }

    static func engine() throws -> MaterialEngine {
        var options = EngineOptions()
        options.size = size
        options.threads = 2
        options.model = try model()
        return try MaterialEngine(options: options)
    }

    static func pixels() -> Data {
        var data = Data(capacity: 3 * side * side)
        for y in 0..<side {
            for x in 0..<side {
                let (dx, dy) = (x - side / 2, y - side / 2)
                let light = 200 - 160 * (dx * dx + dy * dy) / (side * side)
                let dark = (x / 16 + y / 16) % 2 + 1
                data.append(contentsOf: [UInt8(light / dark), UInt8(light / dark / 2), UInt8(light / 4)])
            }
        }
        return data
    }

    static func photo() -> Photo { Photo(format: .rgb8, width: side, height: side, data: pixels()) }

    static var fast: CaptureOptions {
        var options = CaptureOptions()
        options.refine = false
        return options
    }
}

/// That `work` throws a FlashmatError with this code.
func assertFails<T>(
    _ code: FlashmatError.Code, _ text: String = "", file: StaticString = #filePath, line: UInt = #line,
    _ work: () async throws -> T
) async {
    do {
        _ = try await work()
        XCTFail("no error", file: file, line: line)
    } catch let error as FlashmatError {
        XCTAssertEqual(error.code, code, "\(error)", file: file, line: line)
        XCTAssertTrue(text.isEmpty || error.message.contains(text), "\(error)", file: file, line: line)
    } catch {
        XCTFail("\(error)", file: file, line: line)
    }
}
