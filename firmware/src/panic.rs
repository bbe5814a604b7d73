//! The proof that nothing panics: the handler calls what does not exist, so an image that could reach it does not link.
#![allow(unsafe_code)]

// SAFETY: the function has no definition, so no signature can contradict one.
unsafe extern "C" {
    fn this_image_can_panic() -> !;
}

#[panic_handler]
fn refuse(_: &core::panic::PanicInfo) -> ! {
    // SAFETY: no image that reaches this call exists.
    unsafe { this_image_can_panic() }
}
