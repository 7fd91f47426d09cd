//! Deterministic parallelism over row blocks: cut the output planes into blocks of rows, run them in any order.
//!
//! An [`Executor`] only knows how to run two closures, maybe at once; [`for_each_row_block`] cuts everything else
//! recursively with `split_at_mut`, so no `unsafe` is needed and nothing is allocated. Block borders depend on the
//! sizes alone, never on the number of threads, and every row is written by one closure call: the result has the same
//! bits on every executor. Reductions ([`sum_row_blocks`]) add up the blocks' values as a tree that depends on the
//! sizes alone.
use crate::Error;
use crate::base::simd::Simd;
use core::ops::{ControlFlow, Range};
#[cfg(feature = "parallel")]
use core::sync::atomic::{AtomicBool, Ordering};
#[cfg(feature = "parallel")]
use std::{
    sync::Arc,
    time::{Duration, Instant},
};

/// Rows per block that suit most stages: small enough to share out, large enough to hide the call.
pub const ROWS_PER_BLOCK: usize = 8;

/// Told how much of the work is done, \[0,1\], on the calling thread; may stop it, which is [`Error::Cancelled`].
pub type Watch<'w> = &'w mut dyn FnMut(f32) -> ControlFlow<()>;

/// Runs two closures, one after the other or at once; says which vector registers float loops may use.
pub trait Executor: Sync {
    /// Calls each of `a` and `b` once and returns when both are done.
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send));

    /// Calls `work` once, where this executor's joins are cheapest, and returns when it is done.
    fn within(&self, work: &mut (dyn FnMut() + Send)) {
        work();
    }

    /// The vector registers of float loops: what every CPU of the target has, unless an [`At`] says otherwise.
    fn simd(&self) -> Simd {
        Simd::BASELINE
    }
}

/// An executor whose float loops use the vector registers of a CPU level.
#[derive(Clone, Copy)]
pub struct At<'e> {
    exec: &'e dyn Executor,
    simd: Simd,
}

impl<'e> At<'e> {
    /// `exec` with `simd`.
    #[must_use]
    pub fn new(exec: &'e dyn Executor, simd: Simd) -> Self {
        Self { exec, simd }
    }
}

impl Executor for At<'_> {
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
        self.exec.join(a, b);
    }

    fn within(&self, work: &mut (dyn FnMut() + Send)) {
        self.exec.within(work);
    }

    fn simd(&self) -> Simd {
        self.simd
    }
}

/// The default executor: everything on the calling thread.
#[derive(Clone, Copy, Debug, Default)]
pub struct Inline;

impl Executor for Inline {
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
        a();
        b();
    }
}

/// A rayon thread pool of its own (feature `parallel`).
///
/// Rayon allocates when the pool is built and may allocate in its job queue; the pipeline itself does not.
#[cfg(feature = "parallel")]
#[derive(Debug)]
pub struct Pool(rayon::ThreadPool);

#[cfg(feature = "parallel")]
impl Pool {
    /// A pool of `threads` threads (0: one per CPU).
    ///
    /// # Errors
    /// [`Error::Threads`] when the system gives no threads.
    pub fn new(threads: usize) -> Result<Self, Error> {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().map(Self).map_err(|_| Error::Threads)
    }

    /// Threads in the pool.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.0.current_num_threads()
    }
}

#[cfg(feature = "parallel")]
impl Executor for Pool {
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
        self.0.install(|| rayon::join(a, b));
    }

    /// On a thread of the pool: from there a join is a push on its queue, from outside it wakes a thread and waits for it,
    /// which takes longer than the work of a small layer or of a step of the solver. For the same reason the other threads
    /// stay awake until the work is done or has had nothing for them for [`PATIENCE`], giving way to any other program that
    /// wants their CPU.
    fn within(&self, work: &mut (dyn FnMut() + Send)) {
        if self.threads() == 1 || self.0.current_thread_index().is_some() {
            return self.0.install(work);
        }
        self.0.install(|| {
            let awake = Awake(Arc::new(AtomicBool::new(true)));
            let (wanted, here) = (Arc::clone(&awake.0), self.0.current_thread_index());
            self.0.spawn_broadcast(move |thread| {
                let mut idle = Instant::now();
                // The thread that does the work finds this too, while it waits for the other half of a join.
                while Some(thread.index()) != here
                    && wanted.load(Ordering::Relaxed)
                    && idle.elapsed() < PATIENCE
                {
                    if rayon::yield_now() == Some(rayon::Yield::Executed) {
                        idle = Instant::now();
                    } else {
                        std::thread::yield_now();
                    }
                }
            });
            work();
        });
    }
}

/// How long a thread stays awake without a job. It must not stay for ever: it may have been in the middle of a job of
/// other work when it took to waiting for this one's.
#[cfg(feature = "parallel")]
const PATIENCE: Duration = Duration::from_millis(5);

/// Lets the threads sleep again when the work is done, even if it panics.
#[cfg(feature = "parallel")]
struct Awake(Arc<AtomicBool>);

#[cfg(feature = "parallel")]
impl Drop for Awake {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Runs `work`, which makes many joins, by [`Executor::within`].
///
/// # Errors
/// Those of `work`; [`Error::Threads`] from an executor that does not call it.
pub fn within<T: Send>(
    exec: &dyn Executor,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> Result<T, Error> {
    let (mut work, mut result) = (Some(work), Err(Error::Threads));
    exec.within(&mut || {
        if let Some(work) = work.take() {
            result = work();
        }
    });
    result
}

/// Outputs that can be cut between two rows: a [`Plane`], or a tuple or array of such.
pub trait Rows: Send + Sized {
    /// Cuts before `row`; a `row` past the end gives an empty second part.
    fn split_rows(self, row: usize) -> (Self, Self);
}

/// Mutable rows of `width` values each, one after the other.
#[derive(Debug)]
pub struct Plane<'a, T> {
    data: &'a mut [T],
    width: usize,
}

impl<'a, T> Plane<'a, T> {
    /// Rows of `width` values over `data`; values past the last whole row are never touched.
    #[must_use]
    pub fn new(data: &'a mut [T], width: usize) -> Self {
        Self { data, width: width.max(1) }
    }

    /// The rows, in order.
    pub fn rows(&mut self) -> core::slice::ChunksExactMut<'_, T> {
        self.data.chunks_exact_mut(self.width)
    }

    /// All values of the block.
    pub fn values(&mut self) -> &mut [T] {
        self.data
    }
}

/// Three planes stored one after the other in `data`, `width` values to a row and `rows` rows each.
///
/// Planes past the end of `data` come out short; callers check lengths up front.
#[must_use]
pub fn planes3<T>(data: &mut [T], width: usize, rows: usize) -> [Plane<'_, T>; 3] {
    let size = width.saturating_mul(rows);
    let (x, rest) = data.split_at_mut(size.min(data.len()));
    let (y, z) = rest.split_at_mut(size.min(rest.len()));
    [Plane::new(x, width), Plane::new(y, width), Plane::new(z, width)]
}

impl<T: Send> Rows for Plane<'_, T> {
    fn split_rows(self, row: usize) -> (Self, Self) {
        let at = row.saturating_mul(self.width).min(self.data.len());
        let (a, b) = self.data.split_at_mut(at);
        (Self { data: a, width: self.width }, Self { data: b, width: self.width })
    }
}

impl<R: Rows> Rows for [R; 3] {
    fn split_rows(self, row: usize) -> (Self, Self) {
        let [x, y, z] = self;
        let ((x0, x1), (y0, y1), (z0, z1)) = (x.split_rows(row), y.split_rows(row), z.split_rows(row));
        ([x0, y0, z0], [x1, y1, z1])
    }
}

impl<A: Rows, B: Rows> Rows for (A, B) {
    fn split_rows(self, row: usize) -> (Self, Self) {
        let ((a0, a1), (b0, b1)) = (self.0.split_rows(row), self.1.split_rows(row));
        ((a0, b0), (a1, b1))
    }
}

impl<A: Rows, B: Rows, C: Rows> Rows for (A, B, C) {
    fn split_rows(self, row: usize) -> (Self, Self) {
        let ((a0, a1), (b0, b1), (c0, c1)) =
            (self.0.split_rows(row), self.1.split_rows(row), self.2.split_rows(row));
        ((a0, b0, c0), (a1, b1, c1))
    }
}

/// The sum of `body(rows)` over blocks of at most `block` of the `rows` rows, added up as a binary tree whose shape
/// depends on the sizes alone.
pub fn sum_row_blocks<const N: usize>(
    exec: &dyn Executor,
    rows: Range<usize>,
    block: usize,
    body: &(dyn Fn(Range<usize>) -> [f64; N] + Sync),
) -> [f64; N] {
    let block = block.max(1);
    let blocks = rows.len().div_ceil(block);
    if blocks <= 1 {
        return body(rows);
    }
    let middle = rows.start + blocks / 2 * block;
    let (mut top, mut bottom) = ([0.0; N], [0.0; N]);
    exec.join(&mut || top = sum_row_blocks(exec, rows.start..middle, block, body), &mut || {
        bottom = sum_row_blocks(exec, middle..rows.end, block, body)
    });
    top.iter_mut().zip(bottom).for_each(|(sum, value)| *sum += value);
    top
}

/// Calls `body(y, row)` for every row of `out`, in blocks of [`ROWS_PER_BLOCK`], compiled for the executor's vector
/// registers: `body` must be `#[inline(always)]`, and what it calls too.
#[inline(always)]
pub(crate) fn for_each_row<T: Send>(
    exec: &dyn Executor,
    rows: usize,
    out: Plane<'_, T>,
    body: impl Fn(usize, &mut [T]) + Sync,
) {
    for_each_row_block(exec, rows, ROWS_PER_BLOCK, out, &|rows, mut block| {
        exec.simd().run(
            #[inline(always)]
            || {
                for (y, row) in rows.zip(block.rows()) {
                    body(y, row);
                }
            },
        );
    });
}

/// Calls `body(rows, block)` for every block of at most `block` of the `rows` rows; `block` holds the same rows of
/// every output plane.
pub fn for_each_row_block<R: Rows>(
    exec: &dyn Executor,
    rows: usize,
    block: usize,
    out: R,
    body: &(dyn Fn(Range<usize>, R) + Sync),
) {
    run(exec, 0..rows, block.max(1), out, body);
}

fn run<R: Rows>(
    exec: &dyn Executor,
    rows: Range<usize>,
    block: usize,
    out: R,
    body: &(dyn Fn(Range<usize>, R) + Sync),
) {
    let blocks = rows.len().div_ceil(block);
    if blocks <= 1 {
        if !rows.is_empty() {
            body(rows, out);
        }
        return;
    }
    let half = blocks / 2 * block;
    let middle = rows.start + half;
    let (top, bottom) = out.split_rows(half);
    let (mut top, mut bottom) = (Some(top), Some(bottom));
    exec.join(
        &mut || {
            if let Some(out) = top.take() {
                run(exec, rows.start..middle, block, out, body);
            }
        },
        &mut || {
            if let Some(out) = bottom.take() {
                run(exec, middle..rows.end, block, out, body);
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    fn fill(exec: &dyn Executor, rows: usize, width: usize, block: usize) -> (Vec<u32>, Vec<u8>) {
        let (mut a, mut b) = (vec![0_u32; 3 * rows * width], vec![0_u8; rows]);
        let out = (planes3(&mut a, width, rows), Plane::new(&mut b, 1));
        for_each_row_block(exec, rows, block, out, &|range, (mut abc, mut flags)| {
            assert!(range.len() <= block);
            for (p, plane) in abc.iter_mut().enumerate() {
                for (row, values) in range.clone().zip(plane.rows()) {
                    for (x, value) in values.iter_mut().enumerate() {
                        *value += u32::try_from(1 + x + width * (row + rows * p)).unwrap_or(0);
                    }
                }
            }
            flags.values().iter_mut().for_each(|f| *f += 1);
        });
        (a, b)
    }

    #[test]
    fn every_row_of_every_plane_is_visited_once() {
        for (rows, width, block) in [(1, 1, 1), (7, 3, 2), (8, 5, 8), (33, 2, 4), (5, 4, 100)] {
            let (a, b) = fill(&Inline, rows, width, block);
            assert!(a.iter().enumerate().all(|(i, &v)| v as usize == i + 1), "{rows} {width} {block}");
            assert!(b.iter().all(|&f| f == 1), "{rows} {width} {block}");
        }
        fill(&Inline, 0, 3, 2);
    }

    #[test]
    fn sums_take_every_row_once() {
        for (rows, block) in [(0, 3), (1, 1), (7, 2), (8, 8), (33, 4), (5, 0)] {
            let sum = sum_row_blocks(&Inline, 0..rows, block, &|range| {
                [range.len() as f64, range.map(|row| row as f64).sum()]
            });
            assert_eq!(sum, [rows as f64, (rows * rows.saturating_sub(1) / 2) as f64]);
        }
    }

    #[cfg(feature = "parallel")]
    #[test]
    fn a_pool_gives_what_inline_gives() {
        for threads in [1, 2, 5] {
            let pool = Pool::new(threads).expect("threads");
            assert_eq!(pool.threads(), threads);
            assert_eq!(fill(&pool, 33, 7, 4), fill(&Inline, 33, 7, 4));
            let sum = |exec: &dyn Executor| {
                sum_row_blocks(exec, 0..101, 3, &|range| [range.map(|row| 1.0 / (1.0 + row as f64)).sum()])
            };
            assert_eq!(sum(&pool).map(f64::to_bits), sum(&Inline).map(f64::to_bits));
            let there =
                within(&pool, || Ok((rayon::current_thread_index().is_some(), fill(&pool, 33, 7, 4))));
            assert_eq!(there, Ok((true, fill(&Inline, 33, 7, 4))));
            assert_eq!(within::<()>(&pool, || Err(Error::PhotoBlack)), Err(Error::PhotoBlack));
        }
    }
}
