//! Occlusion against rays, in scenes that are each made for one fault.

use glam::DVec3;

use super::occlusion::{draw, shown};
use super::shapes::{asset, quad};
use super::{headless, keep};
use crate::rays::{Rays, Seen};
use crate::{
    AmbientOcclusion, Drawable, Frame, Instance, Material, OcclusionMethod, OcclusionNormals,
    OcclusionRadius, Pose, Settings,
};

/// The mean over some pixels of what a function says of each.
fn mean_of(pixels: &[usize], of: impl Fn(usize) -> f64) -> f64 {
    assert!(!pixels.is_empty());
    pixels.iter().map(|i| of(*i)).sum::<f64>() / pixels.len() as f64
}

/// Beside the inner edge of two walls the neighbour that is nearest in depth is often the other wall's.
#[test]
fn beside_an_inner_edge_occlusion_is_nearer_to_rays_with_normals_of_its_own_wall() {
    let size = [128, 80];
    let Some(mut h) = headless(size[0], size[1]) else { return };
    let walls = [
        quad([0.0, -3.0, 0.0], [6.0, 0.0, 6.0], [0.0, 6.0, 0.0], 1.0),
        quad([-6.0, -3.0, 6.0], [6.0, 0.0, -6.0], [0.0, 6.0, 0.0], 1.0),
    ]
    .map(|wall| asset(&h, &wall, Material::default()));
    let here = [Instance::default()];
    let all = walls.each_ref().map(|asset| Drawable { asset, instances: &here });
    // Not along the edge: its pixels are stairs.
    let camera = Pose::look_at(DVec3::new(0.7, 0.5, 4.0), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.7);
    let radius = OcclusionRadius::World(0.5);
    let rays = Rays::of_frame(h.gpu(), &Frame::new(camera, &all)).unwrap().picture(size, radius, 512);
    let truth: Vec<Seen> = rays.into_iter().map(|seen| seen.expect("walls cover the picture")).collect();
    let near_edge: Vec<usize> = (0..truth.len()).filter(|i| truth[*i].openness < 0.85).collect();
    for method in OcclusionMethod::ALL {
        let [nearest, drawn, extended] = OcclusionNormals::ALL.map(|normals| {
            let usual = shown(method, radius, 16);
            let occlusion = usual.occlusion.map(|occlusion| AmbientOcclusion { normals, ..occlusion });
            let picture = draw(&mut h, camera, &all, Settings { occlusion, ..usual });
            keep(&h, &format!("occlusion-edge-{}-{}", method.name(), normals.name()));
            let off = |i: usize| f64::from(picture.as_raw()[4 * i]) / 255.0 - truth[i].openness;
            [mean_of(&near_edge, off), mean_of(&near_edge, |i| off(i).powi(2))]
        });
        let name = method.name();
        println!(
            "{name}, bias and squared error: nearest {nearest:.4?}, drawn {drawn:.4?}, extended {extended:.4?}"
        );
        // Directions that are even in the picture are too few towards walls at a slant, whatever the normal.
        let most = match method {
            OcclusionMethod::Hbao | OcclusionMethod::HbaoPlus | OcclusionMethod::Alchemy => 0.95,
            _ => 0.65,
        };
        for better in [drawn, extended] {
            assert!(better[1] < most * nearest[1], "{name}: {better:.4?} {nearest:.4?}");
        }
    }
}
