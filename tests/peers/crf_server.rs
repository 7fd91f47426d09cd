//! One bilateral kernel of our CRFs, and the plain sum over all pairs, when told to, for `crf.py`.
//!
//! `crf_peer SIZE INPUT OUT`: INPUT holds three planes of features, each divided by its sigma, and then three planes to
//! filter, f32. Each line of standard input is `build`, `apply` or `naive`, and is answered with CPU milliseconds; the
//! last two leave L x in OUT: (L x)_i = sum_j Kn(i,j) (x_i - x_j), Kn = D^-1/2 K D^-1/2, K the product of the Gaussians of
//! the distances in position (sigma 0.06 of the half width) and in features.
use cpu_time::ThreadTime;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::{At, Inline};
use flashmat_core::base::simd::{Level, Simd};
use flashmat_core::crf::feature::SIGMA_POSITION;
use flashmat_core::crf::pairs::Kernel;
use flashmat_core::crf::solver::Operator;
use flashmat_core::crf::system::{Kernels, System, pixels};
use std::io::{BufRead, Write};

/// The sum over all pairs, one thread, no matrix in memory: two passes, one for D.
fn naive(size: usize, features: &[f32], x: &[f32], out: &mut [f32]) {
    let n2 = size * size;
    let scale = 1.0 / pixels(SIGMA_POSITION, size);
    // Pixel by pixel, what it is compared by: position and features in sigmas.
    let at = |i: usize| {
        let position = [(i % size) as f32 * scale, (i / size) as f32 * scale];
        [position[0], position[1], features[i], features[n2 + i], features[2 * n2 + i]]
    };
    let points: Vec<[f32; 5]> = (0..n2).map(at).collect();
    let kernel = |a: &[f32; 5], b: &[f32; 5]| {
        let squared: f32 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
        // Beyond this the exponential is below 1e-17 of a pixel's own.
        if squared > 80.0 { 0.0 } else { (-0.5 * squared).exp() }
    };
    let norm = |a: &[f32; 5]| 1.0 / points.iter().map(|b| f64::from(kernel(a, b))).sum::<f64>().sqrt();
    let norms: Vec<f32> = points.iter().map(|a| norm(a) as f32).collect();
    for (i, a) in points.iter().enumerate() {
        let mut sums = [0.0_f64; 3];
        for (j, b) in points.iter().enumerate() {
            let weight = norms[i] * norms[j] * kernel(a, b);
            for (c, sum) in sums.iter_mut().enumerate() {
                *sum += f64::from(weight * (x[c * n2 + i] - x[c * n2 + j]));
            }
        }
        for (c, sum) in sums.into_iter().enumerate() {
            out[c * n2 + i] = sum as f32;
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [size, input, out] = arguments.as_slice() else {
        return Err("usage: crf_peer SIZE INPUT OUT".into());
    };
    let size: usize = size.parse()?;
    let n2 = size * size;
    let file = std::fs::read(input)?;
    let planes: Vec<f32> = file.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let (features, x) =
        planes.split_at_checked(3 * n2).filter(|(_, x)| x.len() == 3 * n2).ok_or("not 6 planes")?;
    let halved: Vec<f32> = features.iter().map(|f| 0.5 * f).collect();
    let level =
        [Level::Avx512Vnni, Level::Avx2, Level::Scalar].into_iter().find(|level| level.is_supported());
    let exec = At::new(&Inline, Simd::for_level(level.unwrap_or(Level::Scalar))?);
    let unary = vec![0.0; n2];
    // The energy's weight counts twice in its matrix.
    let kernel = Kernel { features: &halved, weight: 0.5 };
    let bilateral = [kernel, Kernel { features: &[], weight: 0.0 }];
    let kernels = Kernels { spatial: (SIGMA_POSITION, 0.0), sigma: SIGMA_POSITION, bilateral };
    let bytes = System::bytes(size, SIGMA_POSITION, SIGMA_POSITION) + 64;
    let (mut workspace, mut scratch) = (vec![0; bytes], vec![0; bytes]);
    let mut arena = Arena::new(&mut workspace);
    let mut system = System::new(size, &unary, &kernels, &exec, &mut arena)?;
    let mut filtered = vec![0.0; 3 * n2];
    println!("ready {}", exec_name(level));
    std::io::stdout().flush()?;
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let start = ThreadTime::now();
        match line.as_str() {
            "build" => drop(System::new(size, &unary, &kernels, &exec, &mut Arena::new(&mut scratch))?),
            "apply" => system.apply(x, &mut filtered, &exec),
            "naive" => naive(size, features, x, &mut filtered),
            _ => return Err("build, apply or naive".into()),
        }
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        if line != "build" {
            std::fs::write(out, filtered.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
        }
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}

fn exec_name(level: Option<Level>) -> &'static str {
    level.map_or("scalar", Level::name)
}
