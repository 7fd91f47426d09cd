//! Where pixels lie: positions in [-1,1]², points on the plane z = 0, directions to camera and light; turning squares.
use super::Rotation;
use crate::base::math::tanf;
use glam::{Vec2, Vec3};

/// Pixel positions of an n x n image over a field of view, camera at (0,0,1) looking down.
#[derive(Clone, Copy, Debug)]
pub struct Geometry {
    size: usize,
    half_tan: f32,
}

impl Geometry {
    /// An image of `size` x `size` pixels that spans `fov_deg` degrees from one side to the other.
    #[must_use]
    pub fn new(size: usize, fov_deg: f32) -> Self {
        Self { size, half_tan: tanf(fov_deg.to_radians() / 2.0) }
    }

    /// Half the side of the square that the image shows, in plane units (1 = the camera's distance).
    #[must_use]
    pub fn half_tan(&self) -> f32 {
        self.half_tan
    }

    /// Position p in [-1,1]² of a pixel's centre, x right, y up.
    #[must_use]
    #[inline(always)]
    pub fn position(&self, row: usize, column: usize) -> Vec2 {
        let n = self.size as f32;
        // Vectors convert i32 fast, usize not.
        let centre = |i: usize| (2 * i as i32 + 1) as f32;
        Vec2::new(centre(column) / n - 1.0, 1.0 - centre(row) / n)
    }

    /// The point of the plane z = 0 that a pixel's centre shows.
    #[must_use]
    #[inline(always)]
    pub fn point(&self, row: usize, column: usize) -> Vec3 {
        (self.position(row, column) * self.half_tan).extend(0.0)
    }

    /// Unit direction from a pixel's point to `eye` (camera or light).
    #[must_use]
    pub fn direction(&self, row: usize, column: usize, eye: Vec3) -> Vec3 {
        let to = eye - self.point(row, column);
        to / to.length()
    }
}

/// Turns a square plane in place.
pub(super) fn rotate_square<T: Copy>(plane: &mut [T], size: usize, rotation: Rotation) {
    match rotation {
        Rotation::None => {}
        Rotation::Cw180 => plane.reverse(),
        Rotation::Cw90 => {
            transpose(plane, size);
            plane.chunks_exact_mut(size).for_each(<[T]>::reverse);
        }
        Rotation::Cw270 => {
            transpose(plane, size);
            flip(plane, size);
        }
    }
}

fn transpose<T: Copy>(plane: &mut [T], size: usize) {
    for row in 0..size {
        for column in row + 1..size {
            plane.swap(row * size + column, column * size + row);
        }
    }
}

fn flip<T: Copy>(plane: &mut [T], size: usize) {
    let (top, bottom) = plane.split_at_mut(size / 2 * size);
    for (a, b) in top.chunks_exact_mut(size).zip(bottom.chunks_exact_mut(size).rev()) {
        a.swap_with_slice(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_pixel_centres_with_y_up() {
        let g = Geometry::new(4, 90.0);
        assert_eq!(g.position(0, 0), Vec2::new(-0.75, 0.75));
        assert_eq!(g.position(3, 2), Vec2::new(0.25, -0.75));
        assert!((g.half_tan() - 1.0).abs() < 1e-6);
        let v = g.direction(3, 2, Vec3::Z);
        let length = (1.0_f32 + 0.25 * 0.25 + 0.75 * 0.75).sqrt();
        assert!((v - Vec3::new(-0.25, 0.75, 1.0) / length).length() < 1e-6);
    }

    #[test]
    fn squares_turn_clockwise() {
        let turned = |rotation| {
            let mut plane = [1, 2, 3, 4, 5, 6, 7, 8, 9];
            rotate_square(&mut plane, 3, rotation);
            plane
        };
        assert_eq!(turned(Rotation::None), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(turned(Rotation::Cw90), [7, 4, 1, 8, 5, 2, 9, 6, 3]);
        assert_eq!(turned(Rotation::Cw180), [9, 8, 7, 6, 5, 4, 3, 2, 1]);
        assert_eq!(turned(Rotation::Cw270), [3, 6, 9, 2, 5, 8, 1, 4, 7]);
        let mut even = [1, 2, 3, 4];
        rotate_square(&mut even, 2, Rotation::Cw90);
        assert_eq!(even, [3, 1, 4, 2]);
    }
}
