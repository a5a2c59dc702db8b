//! What surrounds the models of a scene.

use super::model::Scene;

/// Sets what a scene file calls its surroundings; `colored` if it states background or ambient light.
///
/// # Errors
/// Fault and remedy: an unknown word, or a studio for a scene that cannot be in one.
pub(super) fn set(scene: &mut Scene, word: &str, colored: bool) -> Result<(), String> {
    match word {
        "sky" => Ok(()),
        "studio" if scene.terrain.is_some() => {
            Err("a scene with [terrain] has a sky; remove surroundings = \"studio\"".into())
        }
        "studio" if colored => {
            Err("a studio has its own colors; remove [ambient] and [background], or surroundings".into())
        }
        "studio" => {
            scene.set_studio();
            Ok(())
        }
        other => Err(format!("surroundings are {other:?}; write \"sky\" or \"studio\"")),
    }
}
