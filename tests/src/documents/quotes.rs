//! The README's example is part of a program that a test builds and runs.

use super::repository::Repository;

/// Lines of code of the first block of this language, without blank lines, comments and indentation.
fn code<'a>(document: &'a str, fence: &str) -> Vec<&'a str> {
    let lines = document.lines().skip_while(|line| *line != fence).skip(1);
    let block = lines.take_while(|line| !line.starts_with("```")).map(str::trim);
    block.filter(|line| !line.is_empty() && !line.starts_with("//")).collect()
}

#[test]
fn the_readme_embeds_as_the_example_does() {
    let root = Repository::read().root;
    let read = |path: &str| std::fs::read_to_string(root.join(path)).unwrap();
    let (readme, example) = (read("README.md"), read("examples/embed/src/main.rs"));
    let quoted = code(&readme, "```rust");
    assert!(quoted.len() >= 10, "the README has no example: {quoted:?}");
    let mut built = example.lines().map(str::trim);
    for line in quoted {
        assert!(
            built.any(|other| other == line),
            "README.md, not in examples/embed or not in this order: {line}"
        );
    }
}
