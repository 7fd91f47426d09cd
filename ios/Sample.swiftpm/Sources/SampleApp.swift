import SwiftUI

@main
struct SampleApp: App {
    @StateObject private var model = CaptureModel()

    var body: some Scene {
        WindowGroup {
            NavigationStack {
                CaptureView(model: model)
                    .destination($model.result) { ResultView(result: $0) }
            }
        }
    }
}

extension View {
    /// What iOS 17 calls `navigationDestination(item:)`.
    @ViewBuilder
    func destination<Item: Identifiable, Content: View>(
        _ item: Binding<Item?>, @ViewBuilder content: @escaping (Item) -> Content
    ) -> some View {
        navigationDestination(
            isPresented: Binding(
                get: { item.wrappedValue != nil },
                set: { if !$0 { item.wrappedValue = nil } }
            )
        ) {
            if let value = item.wrappedValue { content(value) }
        }
    }
}
