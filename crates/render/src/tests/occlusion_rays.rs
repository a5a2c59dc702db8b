//! Occlusion against rays, in scenes made to show one fault each.

use glam::DVec3;

use super::occlusion::{draw, shown};
use super::shapes::{Mesh, asset, at, join, quad, sphere};
use super::{headless, keep};
use crate::rays::{RayHit, Rays};
use crate::{
    AmbientOcclusion, Drawable, Frame, Headless, Material, OcclusionMethod, OcclusionNormals,
    OcclusionRadius, Placement, Pose, Settings,
};

/// The mean of a function over some pixels.
fn mean_of(pixels: &[usize], of: impl Fn(usize) -> f64) -> f64 {
    assert!(!pixels.is_empty());
    pixels.iter().map(|i| of(*i)).sum::<f64>() / pixels.len() as f64
}

/// Beside the inner edge of two walls, the neighbour nearest in depth is often on the other wall.
#[test]
fn beside_an_inner_edge_occlusion_is_nearer_to_rays_with_normals_of_its_own_wall() {
    let size = [128, 80];
    let Some(mut h) = headless(size[0], size[1]) else { return };
    let walls = [
        quad([0.0, -3.0, 0.0], [6.0, 0.0, 6.0], [0.0, 6.0, 0.0], 1.0),
        quad([-6.0, -3.0, 6.0], [6.0, 0.0, -6.0], [0.0, 6.0, 0.0], 1.0),
    ]
    .map(|wall| asset(&h, &wall, Material::default()));
    let here = [Placement::default()];
    let all = walls.each_ref().map(|asset| Drawable { asset, instances: &here });
    // Not seen along the edge, whose pixels would be steps.
    let camera = Pose::look_at(DVec3::new(0.7, 0.5, 4.0), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.7);
    let radius = OcclusionRadius::World(0.5);
    let rays = Rays::of_frame(h.gpu(), &Frame::new(camera, &all)).unwrap().picture(size, radius, 512);
    let truth: Vec<RayHit> = rays.into_iter().map(|seen| seen.expect("walls cover the picture")).collect();
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
        // Directions that are even in the picture are too few towards slanting walls, whatever the normal.
        let most = match method {
            OcclusionMethod::Hbao | OcclusionMethod::HbaoPlus | OcclusionMethod::Alchemy => 0.95,
            _ => 0.6,
        };
        for better in [drawn, extended] {
            assert!(better[1] < most * nearest[1], "{name}: {better:.4?} {nearest:.4?}");
        }
    }
}

/// A box from a corner on, faces outwards.
fn block([x, y, z]: [f32; 3], [dx, dy, dz]: [f32; 3]) -> Mesh {
    join(&[
        quad([x, y, z + dz], [dx, 0.0, 0.0], [0.0, dy, 0.0], 1.0),
        quad([x + dx, y, z], [-dx, 0.0, 0.0], [0.0, dy, 0.0], 1.0),
        quad([x + dx, y, z + dz], [0.0, 0.0, -dz], [0.0, dy, 0.0], 1.0),
        quad([x, y, z], [0.0, 0.0, dz], [0.0, dy, 0.0], 1.0),
        quad([x, y + dy, z + dz], [dx, 0.0, 0.0], [0.0, 0.0, -dz], 1.0),
    ])
}

/// The errors in `docs/benchmarks/occlusion.md`: occlusion of a wall two radii behind a pillar, and of faces right
/// behind others whose back the depth buffer does not show; for one, two and four times the radius.
#[test]
fn known_errors_of_half_resolution_stay_bounded() {
    const RADIUS: f32 = 0.4;
    const SIZE: [u32; 2] = [240, 135];
    const BESIDE_PX: usize = 10;
    let Some(mut h) = headless(SIZE[0], SIZE[1]) else { return };
    // The eye is at z = 0 and looks along -z, so faces towards it have one depth each.
    let (wall, pillar, fronts) = (5.0, 4.2, [2.0_f32, 2.7, 3.4, 4.1]);
    let row = fronts.map(|front| block([1.0, -1.0, -front - 0.45], [0.6, 1.0, 0.45]));
    let mesh = join(&[
        quad([-6.0, -1.0, -wall], [12.0, 0.0, 0.0], [0.0, 5.0, 0.0], 1.0),
        quad([-6.0, -1.0, 1.0], [12.0, 0.0, 0.0], [0.0, 0.0, -wall - 1.0], 1.0),
        block([-1.0, -1.0, -pillar - 0.2], [0.4, 4.0, 0.2]),
        join(&row),
    ]);
    let mesh = asset(&h, &mesh, Material::default());
    let all = [Drawable { asset: &mesh, instances: &[Placement::default()] }];
    let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, 0.7);
    let seen_by = |h: &Headless, radius| {
        Rays::of_frame(h.gpu(), &Frame::new(camera, &all)).unwrap().picture(SIZE, radius, 256)
    };
    let radii = [1.0, 2.0, 4.0].map(|factor| OcclusionRadius::World(factor * RADIUS));
    let truths = radii.map(|radius| seen_by(&h, radius));
    let is_at =
        |i: usize, depth: f32| truths[0][i].is_some_and(|seen| (seen.depth - f64::from(depth)).abs() < 1e-4);
    let width = SIZE[0] as usize;
    let beside: Vec<usize> = (0..truths[0].len())
        .filter(|&i| {
            let near = |steps: usize| {
                (i % width >= steps && is_at(i - steps, pillar))
                    || (i % width + steps < width && is_at(i + steps, pillar))
            };
            is_at(i, wall) && (1..=BESIDE_PX).any(near)
        })
        .collect();
    let behind: Vec<usize> =
        (0..truths[0].len()).filter(|&i| fronts[1..].iter().any(|front| is_at(i, *front))).collect();
    let hidden = |pixels: &[usize], truth: &[Option<RayHit>]| {
        mean_of(pixels, |i| truth[i].map_or(0.0, |seen| 1.0 - seen.openness))
    };
    let rays: [[f64; 2]; 3] = truths.each_ref().map(|truth| [hidden(&beside, truth), hidden(&behind, truth)]);
    println!("hidden by rays beside the pillar and in the row, by radius: {rays:.3?}");
    for method in OcclusionMethod::ALL {
        let drawn = [0, 1, 2].map(|k| {
            let picture = draw(&mut h, camera, &all, shown(method, radii[k], 16));
            keep(&h, &format!("occlusion-row-{}-{}", method.name(), 1 << k));
            [&beside, &behind]
                .map(|pixels| mean_of(pixels, |i| 1.0 - f64::from(picture.as_raw()[4 * i]) / 255.0))
        });
        let name = method.name();
        println!("{name}: {drawn:.3?}");
        let points = matches!(method, OcclusionMethod::Ssao | OcclusionMethod::SsaoCentred);
        for (k, ([beside, row], [rays_beside, rays_row])) in drawn.into_iter().zip(rays).enumerate() {
            // Point samples count as hidden up to some radii behind the pillar, which darkens the wall two radii away
            // (bleeding). Marching methods use the distance of what they meet.
            let most = [[0.12, 0.28, 0.08], [0.05, 0.13, 0.15]][usize::from(!points)][k];
            let bleeding = beside - rays_beside;
            assert!((-0.06..most).contains(&bleeding), "{name}, radius {k}: {bleeding}");
            // No method knows what is behind the drawn surfaces.
            let known = [2.8, 1.2, 1.1][k];
            assert!(row < known * rays_row, "{name}, radius {k}: {row} of {rays_row}");
        }
        let [first, _, last] = drawn;
        assert!(last[1] < 0.95 * rays[2][1], "{name}: {last:?}");
        // A larger radius finds more occlusion in the row, and bleeds more.
        assert!(points || last[1] > 1.5 * first[1] && last[0] > first[0] + 0.05, "{name}: {drawn:?}");
    }
}

/// Contact occlusion under a ball: the first step of a march may already pass above the part of the ball that occludes.
#[test]
fn a_ball_is_dark_where_it_stands() {
    let camera = Pose::look_at(DVec3::new(0.6, 1.3, 2.2), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    let radius = OcclusionRadius::Depth(0.06);
    for (size, most) in [([96, 54], 0.97), ([384, 216], 0.88)] {
        let Some(mut h) = headless(size[0], size[1]) else { return };
        let floor = quad([-9.0, 0.0, 9.0], [18.0, 0.0, 0.0], [0.0, 0.0, -18.0], 1.0);
        let [floor, ball] = [floor, sphere(48)].map(|mesh| asset(&h, &mesh, Material::default()));
        let (here, there) = ([Placement::default()], [at(-0.2, 0.3, 0.2, 0.6)]);
        let all =
            [Drawable { asset: &floor, instances: &here }, Drawable { asset: &ball, instances: &there }];
        let rays = Rays::of_frame(h.gpu(), &Frame::new(camera, &all)).unwrap().picture(size, radius, 256);
        let open = |i: usize| rays[i].map_or(1.0, |seen| seen.openness);
        let dark: Vec<usize> = (0..rays.len()).filter(|i| open(*i) < 0.9).collect();
        println!("{size:?}: rays {:.3} at {} pixels", mean_of(&dark, open), dark.len());
        for method in OcclusionMethod::ALL {
            let picture = draw(&mut h, camera, &all, shown(method, radius, 16));
            keep(&h, &format!("occlusion-ball-{}-{}", size[0], method.name()));
            let found = mean_of(&dark, |i| f64::from(picture.as_raw()[4 * i]) / 255.0);
            println!("{}: {found:.3}", method.name());
            match method {
                OcclusionMethod::Ssao | OcclusionMethod::SsaoCentred => assert!(found < 0.8),
                OcclusionMethod::Gtao => assert!(found < most, "{found}"),
                _ => {}
            }
        }
    }
}
