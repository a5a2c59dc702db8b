//! What a pack's key takes from imported materials: their constants and the content of their images, not the images' places
//! in the file.

use lodestream_import::{Channel, HeightMap, ImageSource, ImportedMaterial, MaterialMaps, SurfaceMap};
use lodestream_scene::asset::AssetDescription;

use super::describe::truncated;

/// Encodes materials for [`Key::of_content`](super::cache::Key::of_content). `image` gives the hash of an image's bytes,
/// `None` for one that cannot be read. `None` for materials that cannot be encoded: preparing them is an error.
pub(super) fn encode(
    name: &str,
    materials: &[ImportedMaterial],
    image: &dyn Fn(&ImageSource) -> Option<blake3::Hash>,
) -> Option<Vec<u8>> {
    let constants = materials.iter().map(|material| material.material.clone()).collect();
    let constants = AssetDescription { name: truncated(name), materials: constants, textures: Vec::new() };
    let mut bytes = constants.encode().ok()?;
    let mut writer = Writer { bytes: &mut bytes, image };
    // The patterns name all fields, so a new one does not compile until it is encoded here.
    for ImportedMaterial { material: _, maps, alpha_from_map } in materials {
        let MaterialMaps { color, opacity, surface, occlusion: apart, normal, emission, height } = maps;
        let SurfaceMap { occlusion, roughness, metallic } = surface;
        writer.bytes.push(u8::from(*alpha_from_map));
        [color, normal, emission].into_iter().for_each(|map| writer.optional(map.as_ref(), Writer::image));
        for channel in [opacity, occlusion, roughness, metallic] {
            writer.optional(channel.as_ref(), Writer::channel);
        }
        writer.optional(height.as_ref(), Writer::height);
        // Nothing where nearly all materials have none, whose keys stay as they were.
        apart.iter().for_each(|channel| writer.channel(channel));
    }
    Some(bytes)
}

struct Writer<'a> {
    bytes: &'a mut Vec<u8>,
    image: &'a dyn Fn(&ImageSource) -> Option<blake3::Hash>,
}

impl Writer<'_> {
    fn optional<T>(&mut self, value: Option<&T>, write: impl Fn(&mut Self, &T)) {
        self.bytes.push(u8::from(value.is_some()));
        value.into_iter().for_each(|value| write(self, value));
    }

    fn image(&mut self, image: &ImageSource) {
        let hash = (self.image)(image);
        self.optional(hash.as_ref(), |writer, hash| writer.bytes.extend(hash.as_bytes()));
    }

    fn channel(&mut self, channel: &Channel) {
        let Channel { image, component, inverted, strength } = channel;
        self.image(image);
        self.bytes.extend([*component as u8, u8::from(*inverted)]);
        self.bytes.extend(strength.to_le_bytes());
    }

    fn height(&mut self, height: &HeightMap) {
        let HeightMap { image, scale } = height;
        self.image(image);
        self.bytes.extend(scale.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::PathBuf;

    use lodestream_import::Component;

    use super::*;

    #[test]
    fn every_map_and_its_content_count_but_not_its_path() {
        let named = |path: &str| ImageSource::from(PathBuf::from(path));
        let hash = |image: &ImageSource| {
            let name = image.path.file_name()?.to_str()?;
            (name != "missing").then(|| blake3::hash(name.as_bytes()))
        };
        let channel = |path| Some(Channel::plain(named(path), Component::Red));
        let surface = |occlusion, roughness, metallic| SurfaceMap { occlusion, roughness, metallic };
        let maps = MaterialMaps::default;
        let all = [
            maps(),
            MaterialMaps { color: Some(named("a")), ..maps() },
            MaterialMaps { color: Some(named("b")), ..maps() },
            MaterialMaps { color: Some(named("missing")), ..maps() },
            MaterialMaps { normal: Some(named("a")), ..maps() },
            MaterialMaps { emission: Some(named("a")), ..maps() },
            MaterialMaps { opacity: channel("a"), ..maps() },
            MaterialMaps { surface: surface(channel("a"), None, None), ..maps() },
            MaterialMaps { surface: surface(None, channel("a"), None), ..maps() },
            MaterialMaps { surface: surface(None, None, channel("a")), ..maps() },
            MaterialMaps {
                surface: surface(None, None, Some(Channel { inverted: true, ..channel("a").unwrap() })),
                ..maps()
            },
            MaterialMaps { height: Some(HeightMap { image: named("a"), scale: 1.0 }), ..maps() },
            MaterialMaps { height: Some(HeightMap { image: named("a"), scale: 2.0 }), ..maps() },
        ];
        let encoded = |maps: &MaterialMaps, alpha_from_map| {
            let material = ImportedMaterial { maps: maps.clone(), alpha_from_map, ..Default::default() };
            encode("name", &[material], &hash).unwrap()
        };
        let mut keys: BTreeSet<Vec<u8>> = all.iter().map(|maps| encoded(maps, false)).collect();
        keys.insert(encoded(&all[1], true));
        assert_eq!(keys.len(), all.len() + 1);
        let moved = MaterialMaps { color: Some(named("elsewhere/a")), ..maps() };
        assert_eq!(encoded(&moved, false), encoded(&all[1], false));
    }
}
