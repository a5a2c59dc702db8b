//! Wireframe edges: drawn where triangles are large, faded where they are smaller than a few pixels.

use glam::DVec3;

use super::shapes::{Mesh, asset, sphere};
use super::{headless, keep};
use crate::{AntiAliasing, Drawable, Frame, GradientSky, Headless, Material, Placement, Pose, Settings, Sky};

/// Over the pixels of a sphere: the ratio of mean luminance with and without edges, and the share of nearly black
/// pixels.
fn inked(h: &mut Headless, mesh: &Mesh, name: &str) -> (f64, f64) {
    let ball = asset(h, mesh, Material { base_color: [0.7, 0.7, 0.7, 1.0], ..Material::default() });
    let drawables = [Drawable { asset: &ball, instances: &[Placement::default()] }];
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, DVec3::Y, 0.5);
    let mut frame = Frame::new(camera, &drawables);
    frame.settings =
        Settings { anti_aliasing: AntiAliasing::None, shadows: None, occlusion: None, ..frame.settings };
    let plain = GradientSky { ground: glam::Vec3::splat(0.4), ..GradientSky::default() };
    frame.environment.sky = Sky::Plain(plain);
    let mut lumas = [false, true].map(|wireframe| {
        frame.settings.wireframe = wireframe;
        h.frame(&frame).unwrap();
        let picture = h.picture().unwrap();
        let luma = |p: &image::Rgba<u8>| p.0[..3].iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0;
        let covered = h.coverage().unwrap();
        picture
            .pixels()
            .zip(covered)
            .filter(|(_, covered)| *covered)
            .map(|(p, _)| luma(p))
            .collect::<Vec<_>>()
    });
    keep(h, name);
    let [plain, wires] = &mut lumas;
    let black = plain.iter().zip(&*wires).filter(|(plain, wire)| **wire < 0.5 * **plain).count();
    let count = plain.len() as f64;
    (wires.iter().sum::<f64>() / plain.iter().sum::<f64>(), black as f64 / count)
}

#[test]
fn a_fine_mesh_is_not_solid_black_under_its_edges() {
    let Some(mut h) = headless(160, 160) else { return };
    // The sphere is 160 px wide: sides of 1.3, 2.5, 8 and 31 px in its middle.
    let [fine, small, large, coarse] = [192, 100, 32, 8].map(|rings| {
        let found = inked(&mut h, &sphere(rings), &format!("wireframe-{rings}"));
        println!("{rings} rings: {found:?}");
        found
    });
    assert!(fine.0 > 0.97 && fine.1 < 0.03, "{fine:?}");
    assert!(small.0 > 0.9 && small.0 <= fine.0, "{small:?}");
    // Where triangles are large enough, edges are drawn in full: about 3 / side of all pixels.
    assert!((0.15..0.5).contains(&large.1) && large.0 < 0.9, "{large:?}");
    assert!((0.05..0.2).contains(&coarse.1) && (0.8..0.96).contains(&coarse.0), "{coarse:?}");
}
