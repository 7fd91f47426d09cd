// swift-tools-version:5.9
// An app package: open this folder in Xcode 15 or later (build the framework first: ../build-xcframework.sh), choose
// your team, run it on a phone. The simulator has no camera; there it takes a picture from the library.
import AppleProductTypes
import PackageDescription

let package = Package(
    name: "Flashmat Sample",
    platforms: [.iOS("16.0")],
    products: [
        .iOSApplication(
            name: "Flashmat Sample",
            targets: ["Sample"],
            displayVersion: "1.0",
            bundleVersion: "1",
            appIcon: .placeholder(icon: .leaf),
            accentColor: .presetColor(.orange),
            supportedDeviceFamilies: [.phone, .pad],
            supportedInterfaceOrientations: [.portrait],
            capabilities: [
                .camera(purposeString: "Flashmat takes one flash photo of a surface and computes its material on the phone.")
            ]
        )
    ],
    dependencies: [.package(path: "..")],
    targets: [
        .executableTarget(
            name: "Sample",
            dependencies: [.product(name: "Flashmat", package: "ios")],
            path: "Sources"
        )
    ]
)
