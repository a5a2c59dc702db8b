use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, DVec4};

use super::*;
use crate::parts::{PART_SCALES, PartTransform};

fn channel(property: Property, interpolation: Interpolation, values: &[f32]) -> Channel {
    Channel { node: 0, property, interpolation, timeline: 0, values: values.to_vec() }
}

fn near(a: DVec4, b: [f64; 4]) -> bool {
    (a - DVec4::from_array(b)).length() < 1e-6
}

#[test]
fn keyframes_are_interpolated_as_gltf_says() {
    use Interpolation::{CubicSpline, Linear, Step};
    let times = [1.0, 3.0];
    let straight = channel(Property::Translation, Linear, &[0.0, 0.0, 0.0, 4.0, 8.0, -2.0]);
    for (time, want) in [
        (0.0, [0.0; 4]),
        (1.0, [0.0; 4]),
        (1.5, [1.0, 2.0, -0.5, 0.0]),
        (3.0, [4.0, 8.0, -2.0, 0.0]),
        (9.0, [4.0, 8.0, -2.0, 0.0]),
    ] {
        assert!(near(straight.at(&times, time), want), "{time}");
    }
    let step = Channel { interpolation: Step, ..straight };
    assert!(near(step.at(&times, 2.999), [0.0; 4]) && near(step.at(&times, 3.0), [4.0, 8.0, -2.0, 0.0]));
    // In-tangent, value, out-tangent of each keyframe, in units per second.
    let values = [[9.0; 3], [0.0; 3], [1.0; 3], [0.5; 3], [2.0; 3], [9.0; 3]].concat();
    let spline = channel(Property::Scale, CubicSpline, &values);
    // At the middle of two seconds: 1/2 · 0 + 1/8 · 2 · 1 + 1/2 · 2 − 1/8 · 2 · 0.5.
    assert!(near(spline.at(&times, 2.0), [1.125, 1.125, 1.125, 0.0]));
    // A quarter: 27/32 · 0 + 9/64 · 2 · 1 + 5/32 · 2 − 3/64 · 2 · 0.5.
    let quarter = 18.0 / 64.0 + 10.0 / 32.0 - 3.0 / 64.0;
    assert!(near(spline.at(&times, 1.5), [quarter, quarter, quarter, 0.0]));
    assert!(near(spline.at(&times, 0.0), [0.0; 4]) && near(spline.at(&times, 4.0), [2.0, 2.0, 2.0, 0.0]));
    // One keyframe is a constant.
    assert!(near(spline.at(&times[..1], 7.0), [0.0; 4]));
}

#[test]
fn rotations_take_the_short_way_at_constant_speed() {
    let times = [0.0, 1.0];
    let about = |angle: f64| DQuat::from_rotation_z(angle).as_quat().to_array();
    for (from, to, third) in [(0.0, 0.9, 0.3), (0.1, 3.1, 1.1), (-3.0, 3.0, -3.0 + (6.0 - 2.0 * PI) / 3.0)] {
        for sign in [1.0, -1.0] {
            let values = [about(from), about(to).map(|x| x * sign)].concat();
            let turn = channel(Property::Rotation, Interpolation::Linear, &values);
            let found = turn.at(&times, 1.0 / 3.0);
            let angle = DQuat::from_vec4(found).angle_between(DQuat::from_rotation_z(third));
            assert!(angle < 1e-6 && (found.length() - 1.0).abs() < 1e-12, "{from} to {to}: {angle}");
        }
    }
    // Equal and zero quaternions.
    let still = channel(Property::Rotation, Interpolation::Linear, &[0.0; 8]);
    assert!(near(still.at(&times, 0.5), [0.0, 0.0, 0.0, 1.0]));
    // Splines and steps are made of unit length.
    let long = [0.0, 0.0, 3.0, 3.0, 0.0, 0.0, 3.0, 3.0];
    let step = channel(Property::Rotation, Interpolation::Step, &long);
    assert!(near(step.at(&times, 0.5), [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]));
}

/// An arm of two nodes: the upper one turns about z, the lower one moves along x.
fn arm() -> AnimatedModel {
    let turn: Vec<f32> = [DQuat::IDENTITY, DQuat::from_rotation_z(PI / 2.0)]
        .iter()
        .flat_map(|q| q.as_quat().to_array())
        .collect();
    let upper = AnimatedNode {
        parent: None,
        to_parent: DAffine3::from_translation(DVec3::new(10.0, 0.0, 0.0)),
        rest: Rest::default(),
    };
    let lower = AnimatedNode {
        parent: Some(0),
        to_parent: DAffine3::from_rotation_x(0.25),
        rest: Rest { translation: [1.0, 0.1, 0.0], scale: [2.0; 3], ..Rest::default() },
    };
    let clip = Clip {
        name: "reach".into(),
        channels: vec![
            channel(Property::Rotation, Interpolation::Linear, &turn),
            Channel {
                node: 1,
                timeline: 1,
                ..channel(Property::Translation, Interpolation::Linear, &[1.0, 0.0, 0.0, 5.0, 0.0, 0.0])
            },
        ],
    };
    let part = |node| AnimatedPart {
        node,
        to_node: DAffine3::from_scale(DVec3::splat(0.5)),
        from_model: DAffine3::from_translation(DVec3::new(-1.0, 2.0, 1e6 + 0.1)),
    };
    AnimatedModel {
        nodes: vec![upper, lower],
        parts: vec![part(0), part(1)],
        skins: vec![AnimatedSkin {
            joints: vec![
                SkinJoint { node: Some(1), to_node: DAffine3::from_translation(DVec3::new(-11.0, 0.0, 0.0)) },
                SkinJoint { node: None, to_node: DAffine3::IDENTITY },
            ],
        }],
        places: vec![vec![3, 7, 8], vec![2, 300, 301]],
        timelines: vec![vec![0.0, 2.0], vec![0.0, 4.0]],
        clips: vec![clip, Clip { name: "rest".into(), channels: Vec::new() }],
    }
}

#[test]
fn nodes_follow_those_above_them() {
    let model = arm();
    let nodes = model.nodes_at(model.clips.first(), 1.0);
    let upper = DAffine3::from_translation(DVec3::new(10.0, 0.0, 0.0)) * DAffine3::from_rotation_z(PI / 4.0);
    let own = DAffine3::from_translation(DVec3::new(2.0, 0.0, 0.0)) * DAffine3::from_scale(DVec3::splat(2.0));
    let lower = upper * DAffine3::from_rotation_x(0.25) * own;
    assert!(nodes[0].abs_diff_eq(upper, 1e-7) && nodes[1].abs_diff_eq(lower, 1e-7), "{nodes:?}");
    let place = DVec3::new(0.3, -0.2, 0.7);
    let transforms = model.transforms_at(model.clips.first(), 1.0);
    for (part, transform) in model.parts.iter().zip(transforms) {
        let map = part.from_model * nodes[part.node as usize] * part.to_node;
        assert!(transform.apply(place).distance(map.transform_point3(place)) < 1e-7);
    }
}

#[test]
fn clips_of_several_models_are_known_by_name_and_repeat() {
    let (arm, mut other) = (arm(), arm());
    other.clips.remove(0);
    other.clips[0].channels = vec![channel(Property::Scale, Interpolation::Step, &[1.0; 6])];
    other.places = vec![vec![0, 1, 9]];
    let mut all = Animations::default();
    all.insert(4, Arc::new(other));
    all.insert(0, Arc::new(arm.clone()));
    let clips: Vec<_> = all.clips().into_iter().map(|clip| (clip.name, clip.duration_s)).collect();
    assert_eq!(clips, [("reach".to_owned(), 4.0), ("rest".to_owned(), 2.0)]);
    let at = |time_s| all.moved(Some(&Moment { clip: "reach".into(), time_s })).instances;
    assert_eq!(at(1.0).into_keys().collect::<Vec<_>>(), [0, 1, 2, 3, 7, 300]);
    assert_eq!(at(1.0)[&7], arm.transforms_at(arm.clips.first(), 1.0)[1]);
    assert_eq!(at(1.0)[&300], at(1.0)[&7]);
    assert_eq!(at(4.0)[&7], arm.transforms_at(arm.clips.first(), 4.0)[1], "the end is shown");
    assert_eq!(at(9.0), at(1.0));
    assert_eq!(at(-3.0), at(1.0));
}

#[test]
fn uneven_and_lost_volume_have_a_nearest_similarity() {
    let nearest = similarity::nearest;
    let (turn, move_by) = (DQuat::from_rotation_y(1.2), DVec3::new(1e7, 2.0, -3.0));
    let even = DAffine3::from_scale_rotation_translation(DVec3::splat(3.0), turn, move_by);
    let found = nearest(&even);
    assert!((found.scale() - 3.0).abs() < 1e-12 && found.rotation().angle_between(turn) < 1e-7);
    assert_eq!(found.translation(), move_by);
    assert!(is_similarity(&even.matrix3, 1e-9));
    // The rotation of the polar decomposition, and the volume of the map.
    let uneven = DAffine3::from_mat3_translation(
        DMat3::from_quat(turn) * DMat3::from_diagonal(DVec3::new(1.0, 8.0, 1.0)),
        move_by,
    );
    let found = nearest(&uneven);
    assert!((found.scale() - 2.0).abs() < 1e-9 && found.rotation().angle_between(turn) < 1e-7, "{found:?}");
    assert!(!is_similarity(&uneven.matrix3, 0.1));
    for lost in [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::new(-1.0, 1.0, 1.0), DVec3::splat(1e200)] {
        let found = nearest(&DAffine3::from_scale(lost));
        assert_eq!(found.scale(), *PART_SCALES.start(), "{lost}");
    }
    assert_eq!(nearest(&DAffine3::from_translation(DVec3::splat(1e300))), PartTransform::IDENTITY);
}

#[test]
fn models_come_back_and_other_bytes_are_errors() {
    let model = arm();
    let bytes = model.to_bytes().unwrap();
    assert_eq!(AnimatedModel::from_bytes(&bytes).as_ref(), Ok(&model));
    for length in 0..bytes.len() {
        assert!(AnimatedModel::from_bytes(&bytes[..length]).is_err(), "{length}");
    }
    assert!(AnimatedModel::from_bytes(&[&bytes[..], &[0]].concat()).is_err());
    assert_eq!(AnimatedModel::from_bytes(&[9, 0]), Err(AnimationError::Version(9)));
    for at in 0..bytes.len() {
        for flip in [0xff, 1, 0x80] {
            let mut damaged = bytes.clone();
            damaged[at] ^= flip;
            // Never a panic; what decodes is what would be encoded, and can be played.
            if let Ok(model) = AnimatedModel::from_bytes(&damaged) {
                assert_eq!(model.to_bytes().unwrap(), damaged);
                let _ = model.transforms_at(model.clips.first(), 0.7);
            }
        }
    }
}

#[test]
fn models_that_contradict_themselves_are_refused() {
    use AnimationError as E;
    let refused = |change: fn(&mut AnimatedModel)| {
        let mut model = arm();
        change(&mut model);
        model.to_bytes().unwrap_err()
    };
    assert_eq!(refused(|model| model.nodes[1].parent = Some(1)), E::NoSuch("parent"));
    assert_eq!(refused(|model| model.parts[0].node = 2), E::NoSuch("node"));
    assert_eq!(refused(|model| model.places[1].truncate(2)), E::NoSuch("part"));
    assert_eq!(refused(|model| model.skins[0].joints[0].node = Some(2)), E::NoSuch("node"));
    assert_eq!(
        refused(|model| model.skins[0].joints[1].to_node.translation.x = f64::INFINITY),
        E::Number("joint")
    );
    assert_eq!(
        refused(|model| model.skins[0].joints = vec![model.skins[0].joints[0]; 257]),
        E::TooMany("joints")
    );
    assert_eq!(
        refused(|model| model.places = vec![vec![3, 7, 8]; MAX_PLACED_JOINTS / 2 + 1]),
        E::TooMany("joints in all its places")
    );
    assert_eq!(refused(|model| model.timelines[0][1] = 0.0), E::Keyframes);
    assert_eq!(refused(|model| model.timelines[0][0] = -1.0), E::Keyframes);
    assert_eq!(refused(|model| model.timelines[0][1] = f32::NAN), E::Keyframes);
    assert_eq!(refused(|model| model.timelines[1].clear()), E::Keyframes);
    assert_eq!(refused(|model| model.clips[0].channels[0].values.truncate(7)), E::Keyframes);
    assert_eq!(refused(|model| model.clips[0].channels[1].timeline = 2), E::NoSuch("timeline"));
    assert_eq!(refused(|model| model.clips[0].channels[1].node = 2), E::NoSuch("node"));
    assert_eq!(refused(|model| model.clips[0].channels[1].values[0] = f32::INFINITY), E::Number("keyframe"));
    assert_eq!(refused(|model| model.nodes[0].rest.rotation = [0.0; 4]), E::Number("node"));
    assert_eq!(refused(|model| model.nodes[0].rest.scale[1] = f64::NAN), E::Number("node"));
    assert_eq!(refused(|model| model.clips[0].name = "x".repeat(256)), E::TooMany("bytes in a clip's name"));
    assert_eq!(AnimationTable { models: 0 }.check(), Err(E::Models(0)));
    assert!(AnimationTable { models: MAX_ANIMATED_MODELS + 1 }.check().is_err());
}

#[test]
fn vertices_follow_their_joints_by_weight() {
    let model = arm();
    let clip = model.clips.first();
    let pose = &model.poses_at(clip, 1.0)[0];
    let lower = model.nodes_at(clip, 1.0)[1];
    let (place, followed) = (DVec3::new(12.0, 1.0, 0.5), pose.joints()[0]);
    assert!(followed.abs_diff_eq(lower * DAffine3::from_translation(DVec3::new(-11.0, 0.0, 0.0)), 1e-9));
    let at = |influences: &[(u8, u8)]| pose.apply(influences.iter().copied(), place);
    assert!(at(&[(0, 255)]).distance(followed.transform_point3(place)) < 1e-9);
    assert!(at(&[(1, 255)]).distance(place) < 1e-12 && at(&[(9, 255)]).distance(place) < 1e-12);
    let between = followed.transform_point3(place) * 0.2 + place * 0.8;
    assert!(at(&[(0, 51), (1, 204)]).distance(between) < 1e-9);
    let mut all = Animations::default();
    all.insert(0, Arc::new(model.clone()));
    let moment = Moment { clip: "reach".into(), time_s: 1.0 };
    assert_eq!(all.moved(Some(&moment)).skins.get(&301), Some(pose));
    assert_eq!(all.moved(Some(&moment)).skins.len(), 2);
    // At rest, the joints are elsewhere than the asset has them, and nothing else moves.
    let rest = all.moved(None);
    assert_eq!((rest.instances.len(), rest.skins.get(&8)), (0, Some(&model.poses_at(None, 0.0)[0])));
    let mut still = model;
    still.skins[0].joints.remove(0);
    all.insert(0, Arc::new(still));
    assert!(all.moved(None).skins.is_empty());
}

#[test]
fn the_similarities_of_a_pose_hold_what_follows_it() {
    let stretched = DAffine3::from_scale_rotation_translation(
        DVec3::new(1.0, 3.0, 0.5),
        DQuat::from_rotation_z(0.4),
        DVec3::new(5.0, 0.0, 0.0),
    );
    let turned = DAffine3::from_rotation_x(2.0);
    let pose = SkinPose::new([stretched, turned, turned]);
    let similarities = pose.similarities();
    assert_eq!(similarities.len(), 2);
    let scales: Vec<f64> = similarities.iter().map(PartTransform::scale).collect();
    assert!(scales.iter().any(|s| (s - 1.0).abs() < 1e-9) && scales.iter().any(|s| (s - 3.0).abs() < 1e-9));
    let sphere = (DVec3::ZERO, 2.0);
    let (centre, radius) = PartTransform::bounds(similarities.iter(), sphere);
    for step in 0..100 {
        let turn = DQuat::from_rotation_y(f64::from(step)) * DQuat::from_rotation_x(f64::from(step) * 0.7);
        let at = pose
            .apply([(0, (step * 2) as u8), (1, (255 - step * 2) as u8)].into_iter(), turn * (DVec3::X * 2.0));
        assert!(at.distance(centre) <= radius * (1.0 + 1e-9));
    }
}
