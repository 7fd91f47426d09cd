//! What the linker wants of a library without `std`: a panic handler.
#![expect(unsafe_code, reason = "calls a function of the program")]

unsafe extern "C" {
    /// Defined by the program: stops it, resets the device, or halts for a debugger.
    safe fn flashmat_on_panic() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    flashmat_on_panic()
}
