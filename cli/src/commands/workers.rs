//! Many pieces of work, one engine for each thread: memory stays bounded however many pieces there are.
use crate::engine::{Engine, Loaded, Settings};
use crate::failure::Failure;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes that the workspaces of all engines together may take.
const MEMORY: usize = 4 << 30;

/// How many engines to run side by side, and `settings` with the threads that each may use.
///
/// Photos share nothing, so side by side comes first, as far as the memory reaches; threads that are left help inside.
/// Fails where an engine cannot be made at all.
pub(crate) fn plan(
    threads: usize,
    pieces: usize,
    model: &Loaded<'_>,
    settings: Settings,
) -> Result<(usize, Settings), Failure> {
    let one = Engine::new(model, &Settings { threads: 1, ..settings.clone() })?.workspace_bytes();
    let (workers, threads) = share_out(threads, pieces, MEMORY / one.max(1));
    Ok((workers, Settings { threads, ..settings }))
}

fn share_out(threads: usize, pieces: usize, room: usize) -> (usize, usize) {
    let workers = threads.min(pieces).min(room).max(1);
    (workers, (threads / workers).max(1))
}

/// Calls `work` for each of 0..`pieces`, on `workers` threads with an engine each.
pub(crate) fn run<'m>(
    workers: usize,
    pieces: usize,
    model: &Loaded<'m>,
    settings: &Settings,
    work: impl Fn(&mut Result<Engine<'m>, Failure>, usize) + Sync,
) {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut engine = Engine::new(model, settings);
        loop {
            let piece = next.fetch_add(1, Ordering::Relaxed);
            if piece >= pieces {
                break;
            }
            work(&mut engine, piece);
        }
    };
    match rayon::ThreadPoolBuilder::new().num_threads(workers).build() {
        Ok(pool) => {
            pool.broadcast(|_| worker());
        }
        // A system without threads to spare still gets its results.
        Err(_) => worker(),
    }
}

#[cfg(test)]
mod tests {
    use super::share_out;

    #[test]
    fn no_thread_is_idle_while_there_is_work_to_share() {
        let cases = [
            ((8, 1, 9), (1, 8)),
            ((8, 3, 9), (3, 2)),
            ((2, 100, 9), (2, 1)),
            ((8, 8, 2), (2, 4)),
            ((4, 0, 0), (1, 4)),
        ];
        for ((threads, pieces, room), wanted) in cases {
            assert_eq!(share_out(threads, pieces, room), wanted);
        }
    }
}
