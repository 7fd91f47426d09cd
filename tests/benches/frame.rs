//! Photo to linear square: `cargo bench -p flashmat-tests --bench frame [-- FILTER]`. A photo of 12 megapixels, one
//! thread, the fastest level; items are the photo's pixels in the square.
use divan::Bencher;
use divan::counter::ItemsCount;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::{At, Inline};
use flashmat_core::base::simd::{Level, Simd};
use flashmat_core::frame::{FieldOfView, Frame, prepare, prepare_bytes};

fn main() {
    divan::main();
}

const WIDTH: usize = 4032;
const HEIGHT: usize = 3024;
const SIZES: [usize; 5] = [128, 256, 512, 1024, 2048];

fn bytes(count: usize) -> Vec<u8> {
    (0..count as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect()
}

fn prepared(bencher: Bencher<'_, '_>, frame: Frame<'_>, size: usize) {
    let exec = At::new(&Inline, Simd::for_level(Level::detect()).expect("this CPU's level"));
    let mut work = vec![0; prepare_bytes(size)];
    bencher.counter(ItemsCount::new(HEIGHT * HEIGHT)).bench_local(|| {
        let image = prepare(&frame, size, &FieldOfView::default(), &exec, &mut Arena::new(&mut work));
        image.expect("prepared").rgb[0]
    });
}

#[divan::bench(args = SIZES)]
fn rgb8(bencher: Bencher<'_, '_>, size: usize) {
    let data = bytes(3 * WIDTH * HEIGHT);
    prepared(bencher, Frame::rgb8(&data, WIDTH, HEIGHT, 3 * WIDTH).expect("frame"), size);
}

#[divan::bench(args = SIZES)]
fn nv12(bencher: Bencher<'_, '_>, size: usize) {
    let data = bytes(WIDTH * HEIGHT * 3 / 2);
    let (luma, chroma) = data.split_at(WIDTH * HEIGHT);
    prepared(bencher, Frame::nv12(luma, WIDTH, chroma, WIDTH, WIDTH, HEIGHT).expect("frame"), size);
}

#[divan::bench(args = [256])]
fn rgb16(bencher: Bencher<'_, '_>, size: usize) {
    let data: Vec<u16> = bytes(3 * WIDTH * HEIGHT).into_iter().map(|code| u16::from(code) * 257).collect();
    prepared(bencher, Frame::rgb16(&data, WIDTH, HEIGHT, 3 * WIDTH).expect("frame"), size);
}

#[divan::bench(args = [256])]
fn float(bencher: Bencher<'_, '_>, size: usize) {
    let data: Vec<f32> = bytes(3 * WIDTH * HEIGHT).into_iter().map(|code| f32::from(code) / 255.0).collect();
    prepared(bencher, Frame::rgb_f32(&data, WIDTH, HEIGHT, 3 * WIDTH).expect("frame"), size);
}
