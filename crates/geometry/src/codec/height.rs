//! Predicts the height of a new vertex above the plane of its ring, with its expected error, by a network of one
//! hidden layer that was trained on the splits of several models (docs/design/coding.md). The weights are part of the
//! format.
//!
//! Lengths are relative to the ring's radius. Sums run over the inputs in order, so results are bit-identical on all
//! machines.

use crate::numbers::truncated;

/// Inputs of the network: heights of the neighbours weighted by proximity, height of the neighbours' Laplacian,
/// position in the plane (away from the old vertex, across, squared distance), the ring's mean h·x², h·y² and h²,
/// height of the old vertex, Laplacian × squared distance, valence / 6 − 1, and the logarithm of the radius.
pub(crate) const INPUTS: usize = 12;
const HIDDEN: usize = 12;
/// Inputs are clamped to this magnitude.
const LIMIT: f64 = 4.0;

/// Returns the height, and four times the binary logarithm of the expected error.
pub(crate) fn predict(inputs: &[f64; INPUTS]) -> (f64, i32) {
    let mut hidden = HIDDEN_BIAS;
    let mut out = OUT_BIAS;
    for (i, x) in inputs.iter().enumerate() {
        let x = x.clamp(-LIMIT, LIMIT);
        for (h, w) in hidden.iter_mut().zip(&HIDDEN_WEIGHTS[i]) {
            *h += w * x;
        }
        for (o, w) in out.iter_mut().zip(&SKIP_WEIGHTS[i]) {
            *o += w * x;
        }
    }
    for (h, weights) in hidden.iter().zip(&OUT_WEIGHTS) {
        let h = h.max(0.0);
        for (o, w) in out.iter_mut().zip(weights) {
            *o += w * h;
        }
    }
    let log = out[1].clamp(-16.0, 4.0) * 4.0;
    // Rounds down: a cast truncates, and `floor` is a call on targets without the instruction.
    let cut = truncated(log);
    (out[0].clamp(-LIMIT, LIMIT), cut - i32::from(log < f64::from(cut)))
}

const HIDDEN_BIAS: [f64; HIDDEN] =
    [-0.0320, 0.4225, -0.1511, 0.1435, 0.1130, 0.4296, 0.4674, 0.0364, 0.0110, 0.4661, 0.0389, 0.4815];
const HIDDEN_WEIGHTS: [[f64; HIDDEN]; INPUTS] = [
    [-0.4308, -0.9006, -1.3783, 0.0467, -0.8773, -0.2750, 0.0575, -1.0577, 1.2134, -0.0852, 0.1278, 0.0224],
    [1.4429, -1.5028, -1.1073, 0.3971, 0.2785, 0.1139, 0.2182, 0.3544, -0.3555, -0.6938, -2.0350, 0.1916],
    [-0.0274, 0.1155, 0.0527, -0.0654, -0.0218, -0.0476, 0.3782, -0.0005, 0.0925, -0.1133, 0.0086, -0.0612],
    [-0.0034, -0.1168, -0.0550, -0.0321, -0.0151, 0.0805, -0.0194, -0.0089, -0.0959, 0.0787, -0.0060, 0.0969],
    [-0.0202, 0.0346, 0.1141, 0.0013, -0.1099, -0.1158, -0.2139, -0.0355, -0.1609, -0.3076, 0.1732, -0.3550],
    [0.3686, 0.9225, 2.0434, -0.2166, 0.8221, -0.1714, -0.2357, -0.3776, -0.3276, 0.3081, 0.1104, -0.1583],
    [0.7723, 0.1509, -0.6088, 0.0383, 0.3441, 0.0175, -0.3959, 1.1040, -0.1486, -0.2513, -0.5404, -0.1526],
    [1.1670, -2.5109, -0.4080, 0.2543, -1.4340, -2.0302, -2.2929, -0.0758, 0.7885, -3.1041, 0.3906, -2.5146],
    [-1.8458, -1.1038, 0.6538, 0.2815, -0.3456, -0.8159, 0.9230, -1.1854, 0.4137, -1.2780, -0.9387, -0.4084],
    [-0.1539, -0.2515, 0.3306, -0.0452, 0.3556, -0.2863, -0.1400, -0.6942, 0.2169, -0.7739, -0.4082, -0.1094],
    [-0.2309, 0.0612, -0.7892, 0.0477, 0.0698, 0.1235, 0.3046, 0.1165, 0.5194, 0.1174, 0.0380, -0.1231],
    [0.1061, 0.1546, 0.2504, -0.0071, -0.0156, 0.0939, -0.0002, -0.0084, 0.5208, 0.1496, -0.0566, -0.3548],
];
const OUT_BIAS: [f64; 2] = [-0.0202, -3.0570];
/// Skip connections from the inputs to the output.
const SKIP_WEIGHTS: [[f64; 2]; INPUTS] = [
    [-0.0779, -0.0564],
    [0.1017, -0.4151],
    [-0.0243, 0.2290],
    [0.0171, 0.2502],
    [-0.0031, 0.1150],
    [0.0077, 0.5434],
    [0.0775, 0.2977],
    [0.3165, 1.9718],
    [0.3834, 0.1400],
    [0.0469, 0.1225],
    [-0.0069, 0.1704],
    [0.0245, -0.5389],
];
const OUT_WEIGHTS: [[f64; 2]; HIDDEN] = [
    [0.0643, 2.5003],
    [-0.0136, -1.8405],
    [-0.0151, 2.3936],
    [0.3123, -0.3767],
    [-0.1105, -0.4959],
    [-0.1325, -1.3785],
    [0.0960, -1.0785],
    [-0.0968, 1.9009],
    [0.0077, 1.8168],
    [-0.0119, -1.7635],
    [0.0198, 2.9345],
    [0.0245, -1.0487],
];
