//! An allocator that counts, to prove that a run allocates nothing. A test program makes it its own:
//! `#[global_allocator] static ALLOCATOR: Counting = Counting;`, and has one test only, for others would be counted.
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

static CALLS: AtomicUsize = AtomicUsize::new(0);

/// The system allocator, counted.
#[derive(Clone, Copy, Debug)]
pub struct Counting;

/// Allocations so far in this program.
#[must_use]
pub fn calls() -> usize {
    CALLS.load(Ordering::Relaxed)
}

// SAFETY: every call goes to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps `alloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps `dealloc`'s contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}
