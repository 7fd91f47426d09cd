// swift-tools-version:5.9
import Foundation
import PackageDescription

// Apple platforms link the xcframework that build-xcframework.sh makes. Elsewhere (tests on Linux) the header is
// compiled through Sources/FlashmatFFI, and FLASHMAT_LIB_DIR names the folder with libflashmat.a.
#if os(Linux)
let folder = ProcessInfo.processInfo.environment["FLASHMAT_LIB_DIR"] ?? "../target/release"
let ffi: Target = .systemLibrary(name: "FlashmatFFI", path: "Sources/FlashmatFFI")
let linker: [LinkerSetting] = [
    .unsafeFlags(["-L", folder]),
    .linkedLibrary("dl"), .linkedLibrary("m"), .linkedLibrary("pthread"),
]
#else
let ffi: Target = .binaryTarget(name: "FlashmatFFI", path: "Flashmat.xcframework")
let linker: [LinkerSetting] = []
#endif

let package = Package(
    name: "Flashmat",
    platforms: [.iOS(.v15), .macOS(.v12)],
    products: [.library(name: "Flashmat", targets: ["Flashmat"])],
    targets: [
        ffi,
        .target(
            name: "Flashmat",
            dependencies: ["FlashmatFFI"],
            resources: [.copy("PrivacyInfo.xcprivacy")],
            swiftSettings: [.enableExperimentalFeature("StrictConcurrency")],
            linkerSettings: linker
        ),
        .testTarget(name: "FlashmatTests", dependencies: ["Flashmat", "FlashmatFFI"]),
    ]
)
