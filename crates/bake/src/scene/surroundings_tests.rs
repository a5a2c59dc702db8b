//! Surroundings of models alone and of scene files.

use std::path::Path;

use lodestream_scene::description::{DEFAULT_AMBIENT, DEFAULT_BACKGROUND};
use lodestream_scene::surroundings::{STUDIO_AMBIENT, STUDIO_BACKGROUND, STUDIO_LIGHT};

use super::file::{SceneError, parse};
use super::model::Scene;

fn parsed(surroundings: &str, rest: &str) -> Result<Scene, SceneError> {
    let text = format!("{surroundings}\n[[asset]]\nname = \"a\"\nfile = \"a.obj\"\n{rest}");
    parse(Path::new("s.toml"), &text)
}

#[test]
fn models_alone_stand_in_a_studio_and_scene_files_say_where_theirs_do() {
    let (sky, studio) = ((DEFAULT_BACKGROUND, DEFAULT_AMBIENT), (STUDIO_BACKGROUND, STUDIO_AMBIENT));
    let alone = Scene::of_models(&["a.obj".into()]).unwrap();
    assert_eq!((alone.background, alone.ambient), studio);
    assert_eq!(alone.light_direction, STUDIO_LIGHT);
    let unsaid = parsed("", "").unwrap();
    assert_eq!((unsaid.background, unsaid.ambient), sky);
    assert_eq!(parsed("surroundings = \"sky\"", "").unwrap(), unsaid);
    let said = parsed("surroundings = \"studio\"", "").unwrap();
    assert_eq!((said.background, said.ambient, said.light_direction), (studio.0, studio.1, STUDIO_LIGHT));
    let lit = parsed("surroundings = \"studio\"", "[light]\ndirection = [0, 1, 0]").unwrap();
    assert_eq!((lit.background, lit.light_direction), (STUDIO_BACKGROUND, [0.0, 1.0, 0.0]));
}

#[test]
fn surroundings_that_cannot_be_are_refused() {
    for (word, rest, words) in [
        ("cave", "", "write \"sky\" or \"studio\""),
        ("studio", "[background]\ncolor = [1, 0, 0]", "a studio has its own colors"),
        ("studio", "[terrain]\namplitude = 10.0", "a scene with [terrain] has a sky"),
    ] {
        let error = parsed(&format!("surroundings = {word:?}"), rest).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("s.toml:1:"), "{error}");
    }
}
