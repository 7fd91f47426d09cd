//! Linear light to 8-bit sRGB codes: a table and one comparison a value, exact for every f32.
//!
//! The definition is the nearest code of [`linear_to_srgb`](super::transfer::linear_to_srgb), half rounded up. That is a
//! rising function of the value (tried for all 2^30 floats of \[0,1\]), so the first value of each code says it all.
//! The power function would take thirty times as long as this.

/// Bits of the least linear value that has code 1, 2, ... 255.
const STEPS: [u32; 255] = [
    0x391f_22b3,
    0x39ee_b40e,
    0x3a46_eb61,
    0x3a8b_3e5d,
    0x3ab3_070b,
    0x3ada_cfb7,
    0x3b01_4c32,
    0x3b15_3089,
    0x3b29_14df,
    0x3b3c_f936,
    0x3b50_f2d1,
    0x3b65_fb9a,
    0x3b7c_3404,
    0x3b89_d05f,
    0x3b96_2333,
    0x3ba3_14be,
    0x3bb0_a731,
    0x3bbe_dcb7,
    0x3bcd_b76c,
    0x3bdd_3966,
    0x3bed_64ae,
    0x3bfe_3b44,
    0x3c07_df90,
    0x3c10_f919,
    0x3c1a_6b32,
    0x3c24_36c7,
    0x3c2e_5cc7,
    0x3c38_de19,
    0x3c43_bba3,
    0x3c4e_f646,
    0x3c5a_8ee2,
    0x3c66_8654,
    0x3c72_dd74,
    0x3c7f_9512,
    0x3c86_5703,
    0x3c8d_1490,
    0x3c94_0396,
    0x3c9b_247c,
    0x3ca2_77a8,
    0x3ca9_fd79,
    0x3cb1_b654,
    0x3cb9_a299,
    0x3cc1_c2a9,
    0x3cca_16e3,
    0x3cd2_9fa4,
    0x3cdb_5d4d,
    0x3ce4_5034,
    0x3ced_78b7,
    0x3cf6_d72f,
    0x3d00_35fc,
    0x3d05_1bb6,
    0x3d0a_1cee,
    0x3d0f_39d1,
    0x3d14_728a,
    0x3d19_c745,
    0x3d1f_382c,
    0x3d24_c56a,
    0x3d2a_6f24,
    0x3d30_3586,
    0x3d36_18b9,
    0x3d3c_18e6,
    0x3d42_3633,
    0x3d48_70cb,
    0x3d4e_c8d3,
    0x3d55_3e73,
    0x3d5b_d1d3,
    0x3d62_8319,
    0x3d69_526a,
    0x3d70_3fee,
    0x3d77_4bce,
    0x3d7e_7627,
    0x3d82_df92,
    0x3d86_9374,
    0x3d8a_56cc,
    0x3d8e_29ad,
    0x3d92_0c28,
    0x3d95_fe50,
    0x3d9a_0036,
    0x3d9e_11ed,
    0x3da2_3385,
    0x3da6_6510,
    0x3daa_a6a1,
    0x3dae_f847,
    0x3db3_5a16,
    0x3db7_cc1c,
    0x3dbc_4e6c,
    0x3dc0_e115,
    0x3dc5_842a,
    0x3dca_37ba,
    0x3dce_fbd6,
    0x3dd3_d08f,
    0x3dd8_b5f5,
    0x3ddd_ac19,
    0x3de2_b30a,
    0x3de7_cad9,
    0x3dec_f395,
    0x3df2_2d4f,
    0x3df7_781a,
    0x3dfc_d3ff,
    0x3e01_2088,
    0x3e03_dfaf,
    0x3e06_a77c,
    0x3e09_77f7,
    0x3e0c_5127,
    0x3e0f_3314,
    0x3e12_1dc6,
    0x3e15_1144,
    0x3e18_0d95,
    0x3e1b_12c2,
    0x3e1e_20d1,
    0x3e21_37cb,
    0x3e24_57b7,
    0x3e27_809a,
    0x3e2a_b27c,
    0x3e2d_ed67,
    0x3e31_3160,
    0x3e34_7e6f,
    0x3e37_d49d,
    0x3e3b_33ed,
    0x3e3e_9c68,
    0x3e42_0e14,
    0x3e45_88fa,
    0x3e49_0d21,
    0x3e4c_9a8f,
    0x3e50_314b,
    0x3e53_d15c,
    0x3e57_7ac9,
    0x3e5b_2d99,
    0x3e5e_e9d2,
    0x3e62_af7c,
    0x3e66_7e9d,
    0x3e6a_5740,
    0x3e6e_3964,
    0x3e72_2512,
    0x3e76_1a54,
    0x3e7a_192d,
    0x3e7e_21a6,
    0x3e81_19e2,
    0x3e83_27c8,
    0x3e85_3a86,
    0x3e87_5222,
    0x3e89_6e9d,
    0x3e8b_8ffc,
    0x3e8d_b641,
    0x3e8f_e170,
    0x3e92_118b,
    0x3e94_4696,
    0x3e96_8094,
    0x3e98_bf89,
    0x3e9b_0376,
    0x3e9d_4c61,
    0x3e9f_9a4b,
    0x3ea1_ed38,
    0x3ea4_452a,
    0x3ea6_a226,
    0x3ea9_042c,
    0x3eab_6b43,
    0x3ead_d76b,
    0x3eb0_48a9,
    0x3eb2_bf02,
    0x3eb5_3a72,
    0x3eb7_bb02,
    0x3eba_40b1,
    0x3ebc_cb86,
    0x3ebf_5b81,
    0x3ec1_f0a8,
    0x3ec4_8afa,
    0x3ec7_2a7d,
    0x3ec9_cf32,
    0x3ecc_791e,
    0x3ecf_2842,
    0x3ed1_dca3,
    0x3ed4_9640,
    0x3ed7_5521,
    0x3eda_1945,
    0x3edc_e2b1,
    0x3edf_b166,
    0x3ee2_856a,
    0x3ee5_5ebc,
    0x3ee8_3d62,
    0x3eeb_215c,
    0x3eee_0ab0,
    0x3ef0_f95d,
    0x3ef3_ed6a,
    0x3ef6_e6d6,
    0x3ef9_e5a7,
    0x3efc_e9e1,
    0x3eff_f37e,
    0x3f01_8146,
    0x3f03_0b82,
    0x3f04_9878,
    0x3f06_2827,
    0x3f07_ba92,
    0x3f09_4fb9,
    0x3f0a_e7a0,
    0x3f0c_8244,
    0x3f0e_1fab,
    0x3f0f_bfd2,
    0x3f11_62be,
    0x3f13_086e,
    0x3f14_b0e5,
    0x3f16_5c22,
    0x3f18_0a29,
    0x3f19_baf9,
    0x3f1b_6e96,
    0x3f1d_24fe,
    0x3f1e_de35,
    0x3f20_9a3b,
    0x3f22_5913,
    0x3f24_1abb,
    0x3f25_df37,
    0x3f27_a687,
    0x3f29_70ae,
    0x3f2b_3dab,
    0x3f2d_0d83,
    0x3f2e_e033,
    0x3f30_b5be,
    0x3f32_8e25,
    0x3f34_6969,
    0x3f36_478c,
    0x3f38_288f,
    0x3f3a_0c74,
    0x3f3b_f33a,
    0x3f3d_dce5,
    0x3f3f_c975,
    0x3f41_b8eb,
    0x3f43_ab48,
    0x3f45_a08f,
    0x3f47_98bf,
    0x3f49_93db,
    0x3f4b_91e2,
    0x3f4d_92d8,
    0x3f4f_96bd,
    0x3f51_9d92,
    0x3f53_a757,
    0x3f55_b410,
    0x3f57_c3bd,
    0x3f59_d65e,
    0x3f5b_ebf6,
    0x3f5e_0485,
    0x3f60_200d,
    0x3f62_3e91,
    0x3f64_600b,
    0x3f66_8486,
    0x3f68_abfa,
    0x3f6a_d671,
    0x3f6d_03e3,
    0x3f6f_345b,
    0x3f71_67d0,
    0x3f73_9e4d,
    0x3f75_d7ca,
    0x3f78_1452,
    0x3f7a_53db,
    0x3f7c_9671,
    0x3f7e_dc0e,
];

/// Equal parts of [0,1], each so short that at most one code begins in it: the curve is nowhere steeper than 12.92 * 255
/// codes, 0.81 in a part.
const PARTS: usize = 4096;

/// Where a code ends, by code: the next one's first value; nothing is at or above NaN.
static ENDS: [f32; 256] = {
    let mut ends = [f32::NAN; 256];
    let mut code = 0;
    while code < STEPS.len() {
        ends[code] = f32::from_bits(STEPS[code]);
        code += 1;
    }
    ends
};

/// The code of each part's first value.
static STARTS: [u8; PARTS] = {
    let (mut starts, mut part, mut code) = ([0; PARTS], 0, 0);
    while part < PARTS {
        while code < 255 && part as f32 / PARTS as f32 >= ENDS[code as usize] {
            code += 1;
        }
        starts[part] = code;
        part += 1;
    }
    starts
};

/// The 8-bit sRGB code of a linear value; below 0 and NaN: 0, above 1: 255.
#[must_use]
#[inline(always)]
pub fn srgb_code(linear: f32) -> u8 {
    // `as` saturates and turns NaN into 0; the product is exact.
    let part = ((linear * PARTS as f32) as i32).clamp(0, PARTS as i32 - 1) as usize;
    let code = STARTS[part];
    code + u8::from(linear >= ENDS[usize::from(code)])
}

#[cfg(test)]
mod tests {
    use super::super::transfer::{linear_to_srgb, srgb_to_linear};
    use super::*;

    /// The definition, by `libm`.
    fn defined(linear: f32) -> u8 {
        (linear_to_srgb(linear) * 255.0 + 0.5) as u8
    }

    #[test]
    fn codes_are_the_definitions_around_every_step_and_part() {
        let parts = (0..=PARTS).map(|part| part as f32 / PARTS as f32);
        for border in STEPS.into_iter().map(f32::from_bits).chain(parts) {
            let bits = border.to_bits();
            for near in bits.saturating_sub(40)..=bits + 40 {
                let linear = f32::from_bits(near);
                assert_eq!(srgb_code(linear), defined(linear), "{linear}");
            }
        }
        for (code, bits) in (1..=255).zip(STEPS) {
            assert_eq!((defined(f32::from_bits(bits)), defined(f32::from_bits(bits - 1))), (code, code - 1));
        }
    }

    #[test]
    fn codes_are_the_definitions_all_over() {
        for bits in (0..2_f32.to_bits()).step_by(4099) {
            let linear = f32::from_bits(bits);
            assert_eq!(srgb_code(linear), defined(linear), "{linear}");
            assert_eq!(srgb_code(-linear), 0, "{linear}");
        }
        for code in 0..=255_u8 {
            assert_eq!(srgb_code(srgb_to_linear(f32::from(code) / 255.0)), code);
        }
        let odd = [(f32::NAN, 0), (7.0, 255), (f32::MAX, 255), (f32::INFINITY, 255), (f32::NEG_INFINITY, 0)];
        for (linear, code) in odd {
            assert_eq!(srgb_code(linear), code);
        }
    }
}
