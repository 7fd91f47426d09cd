//! The photo's unknown light scale, and the coarse-to-fine search for the roughness at each pixel.
