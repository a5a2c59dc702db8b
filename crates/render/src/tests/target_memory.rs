//! Memory of render targets: what the formats say, and never more than stated before.

use glam::DVec3;

use super::headless;
use super::shapes::{asset, at, quad, sphere};
use crate::{
    Alpha, AmbientOcclusion, AntiAliasing, Bloom, ClearCoat, Drawable, Frame, Headless, LightCulling,
    Material, OcclusionMethod, Placement, Pose, PunctualLight, Reflections, Settings, Shadows, Water,
};

const LIGHTS: [PunctualLight; 1] =
    [PunctualLight { position: [1.0, 1.0, 1.0], intensity: [2.0; 3], range: 3.0, spot: None }];
/// Sky maps, octahedral with a border, and the table of the split sum: eight bytes a texel.
const SKY_BYTES: u64 = 8 * (130 * 130 + 6 * 66 * 66 + 32 * 32);

/// Draws a shore with glass under a light: moving, at rest, and at rest until occlusion is accumulated.
fn draw(h: &mut Headless, settings: Settings) -> u64 {
    let floor = quad([-6.0, -0.6, 3.0], [12.0, 0.5, 0.0], [0.0, 0.2, -9.0], 1.0);
    let glass = Material { base_color: [0.7, 0.7, 0.7, 0.4], alpha: Alpha::Blend, ..Material::default() };
    let clear_coat = ClearCoat { factor: 1.0, roughness: 0.1 };
    let glowing = Material { emission: [0.4, 0.1, 0.0], clear_coat, ..Material::default() };
    let (floor, ball, pane) = (
        asset(h, &floor, Material::default()),
        asset(h, &sphere(12), glowing),
        asset(h, &quad([-1.8, -0.6, 1.0], [1.1, 0.0, 0.0], [0.0, 1.4, 0.0], 1.0), glass),
    );
    let here = [Placement::default()];
    let camera = Pose::look_at(DVec3::new(0.3, 0.9, 3.4), DVec3::new(0.0, 0.1, 0.0), DVec3::Y, 0.8);
    for x in [0.2, 0.3, 0.3, 0.3] {
        let there = [at(x, 0.3, 0.0, 0.8)];
        let drawables = [
            Drawable { asset: &floor, instances: &here },
            Drawable { asset: &ball, instances: &there },
            Drawable { asset: &pane, instances: &here },
        ];
        let frame = Frame {
            lights: &LIGHTS,
            water: Some(Water { level: -0.45, clarity: 2.0, ripples: 0.2 }),
            settings,
            ..Frame::new(camera, &drawables)
        };
        h.frame(&frame).unwrap();
    }
    h.renderer().target_bytes()
}

fn usual() -> Settings {
    Settings {
        occlusion: Some(AmbientOcclusion {
            still: Some(OcclusionMethod::Gtao),
            ..AmbientOcclusion::default()
        }),
        shadows: Some(Shadows { map_side: 256, ..Shadows::default() }),
        lights: Some(LightCulling::default()),
        anti_aliasing: AntiAliasing::Temporal,
        ..Settings::default()
    }
}

#[test]
fn it_grows_with_the_picture_as_the_formats_say() {
    let sizes = [(64, 32), (128, 64), (256, 64)];
    let mut per_pixel = Vec::new();
    for size in sizes {
        let Some(mut h) = headless(size.0, size.1) else { return };
        let bytes = draw(&mut h, usual()) - SKY_BYTES;
        let maps = h.renderer().shadow_maps().bytes();
        let pixels = u64::from(size.0) * u64::from(size.1);
        assert!(maps > 0 && maps <= usual().shadows.unwrap().most_bytes());
        per_pixel.push((bytes - maps) / pixels);
        assert_eq!((bytes - maps) % pixels, 0);
    }
    // Depth 4, normal 8, albedo 4, specular reflection 8, occlusion 1 + 1 + 2, sunlight 2, radiance 8, two
    // histories 16, motion 4.
    assert_eq!(per_pixel, [58; 3]);
}

#[test]
fn settings_state_the_most_that_their_frames_take() {
    let spatial = Settings { anti_aliasing: AntiAliasing::Spatial, ..usual() };
    let all = [
        usual(),
        spatial,
        Settings { render_scale: 0.5, ..usual() },
        Settings { render_scale: 0.7, ..spatial },
        Settings { shadows: None, occlusion: None, ..usual() },
        Settings { reflections: Some(Reflections::default()), bloom: Some(Bloom::default()), ..usual() },
        Settings {
            occlusion: Some(AmbientOcclusion {
                half: true,
                still: Some(OcclusionMethod::HbaoPlus),
                ..AmbientOcclusion::default()
            }),
            ..spatial
        },
    ];
    for settings in all {
        let Some(mut h) = headless(90, 70) else { return };
        let bytes = draw(&mut h, settings);
        let most = settings.most_target_bytes((90, 70));
        assert!(bytes <= most + (1 << 20), "{bytes} of {most}: {settings:?}");
        // Nearly all of it is used by a scene that has everything.
        assert!(bytes * 10 >= most * 7, "{bytes} of {most}: {settings:?}");
    }
}
