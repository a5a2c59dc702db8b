//! WGSL's grammar of binary operators (WGSL specification, 8.19): naga accepts expressions without the parentheses that
//! it demands, browsers' compilers refuse them.

use std::path::Path;

/// Words after which an expression begins.
const KEYWORDS: [&str; 11] =
    ["return", "if", "while", "switch", "case", "let", "var", "const", "override", "else", "loop"];
/// Operators, the longer before their prefixes. Assignments and arrows end an expression.
const OPERATORS: [&str; 33] = [
    "<<=", ">>=", "->", "++", "--", "&&", "||", "<<", ">>", "<=", ">=", "==", "!=", "+=", "-=", "*=", "/=",
    "%=", "&=", "|=", "^=", "+", "-", "*", "/", "%", "&", "|", "^", "<", ">", "!", "~",
];
const RELATIONAL: [&str; 6] = ["<", ">", "<=", ">=", "==", "!="];
const BITWISE: [&str; 3] = ["&", "|", "^"];
const SHIFTS: [&str; 2] = ["<<", ">>"];
const LOGICAL: [&str; 2] = ["&&", "||"];

/// Source without comments.
fn without_comments(source: &str) -> String {
    let lines = source.lines().map(|line| line.split("//").next().unwrap_or_default());
    lines.collect::<Vec<_>>().join("\n")
}

/// Length of the template list that begins at `<`, if the name before it takes one.
fn template_list(name: &str, rest: &str) -> Option<usize> {
    let takes_one = ["vec", "mat", "array", "ptr", "atomic", "texture_", "bitcast", "var"];
    if !rest.starts_with('<') || !takes_one.iter().any(|prefix| name.starts_with(prefix)) {
        return None;
    }
    let mut depth = 0;
    for (at, c) in rest.char_indices() {
        match c {
            '<' => depth += 1,
            '>' => depth -= 1,
            ';' | '{' => return None,
            _ => {}
        }
        if depth == 0 {
            return Some(at + 1);
        }
    }
    None
}

fn tokens(source: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = source.trim_start();
    while let Some(first) = rest.chars().next() {
        let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
        let operator = || OPERATORS.iter().find(|operator| rest.starts_with(**operator));
        let (length, skipped) = if is_word(first) {
            let length = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            (length, template_list(&rest[..length], &rest[length..]).unwrap_or(0))
        } else {
            (operator().map_or(first.len_utf8(), |operator| operator.len()), 0)
        };
        tokens.push(&rest[..length]);
        rest = rest[length + skipped..].trim_start();
    }
    tokens
}

/// What the grammar does not allow in one expression, given its binary operators without those in parentheses.
fn fault(operators: &[&str]) -> Option<&'static str> {
    let any = |of: &[&str], among: &[&str]| among.iter().any(|operator| of.contains(operator));
    if any(&BITWISE, operators) {
        let same = operators.iter().all(|operator| *operator == operators[0]);
        return (!same).then_some("a bitwise operator beside another operator");
    }
    if LOGICAL.iter().all(|operator| operators.contains(operator)) {
        return Some("&& beside ||");
    }
    for comparison in operators.split(|operator| LOGICAL.contains(operator)) {
        let sides: Vec<&[&str]> = comparison.split(|operator| RELATIONAL.contains(operator)).collect();
        if sides.len() > 2 {
            return Some("a comparison of a comparison");
        }
        if sides.iter().any(|side| any(&SHIFTS, side) && side.len() > 1) {
            return Some("a shift beside another operator");
        }
    }
    None
}

/// The faults of a source, each with the tokens before it.
fn faults(source: &str) -> Vec<String> {
    let source = without_comments(source);
    let tokens = tokens(&source);
    // Binary operators of the expressions that are open, the innermost last.
    let mut open: Vec<Vec<&str>> = vec![Vec::new()];
    let mut found = Vec::new();
    let mut operand_before = false;
    for (at, &token) in tokens.iter().enumerate() {
        let assignment =
            token == "=" || (token.len() > 1 && token.ends_with('=') && !RELATIONAL.contains(&token));
        let ends = assignment || [",", ";", "{", "}", ":", "@", "->", "++", "--"].contains(&token);
        let closes = [")", "]"].contains(&token);
        if ends || closes || KEYWORDS.contains(&token) {
            let done = if closes { open.pop() } else { open.last_mut().map(std::mem::take) };
            if let Some(why) = fault(&done.unwrap_or_default()) {
                found.push(format!(
                    "{why}, before the end of: {}",
                    tokens[at.saturating_sub(16)..=at].join(" ")
                ));
            }
            operand_before = closes;
        } else if ["(", "["].contains(&token) {
            open.push(Vec::new());
            operand_before = false;
        } else if OPERATORS.contains(&token) {
            if let Some(last) = open.last_mut().filter(|_| operand_before) {
                last.push(token);
            }
            operand_before = false;
        } else {
            operand_before = true;
        }
    }
    assert_eq!(open.len(), 1, "brackets do not match");
    found
}

#[test]
fn operators_that_need_parentheses_are_found() {
    for expression in
        ["a >> b & c", "a & b | c", "a | b << 4u", "a && b || c", "1u << a + b", "a < b == c", "a & b == c"]
    {
        assert_eq!(faults(&format!("let x = f({expression});")).len(), 1, "{expression}");
    }
    for expression in [
        "(a >> b) & c",
        "a | (b << 4u) | (c << 8u)",
        "a && !b && c < -d + 1",
        "vec2<u32>(a >> 1u, b) == vec2<u32>(1u)",
        "1u << (a + b)",
        "a << b < c",
        "bitcast<u32>(a) & b",
        "a[b & 1u] + c",
    ] {
        assert!(faults(&format!("let x = f({expression});")).is_empty(), "{expression}");
    }
}

#[test]
fn all_shaders_have_the_parentheses_that_the_grammar_demands() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/shaders");
    let mut found = Vec::new();
    let mut read = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|extension| extension == "wgsl") {
            let source = std::fs::read_to_string(&file).unwrap();
            assert!(!source.contains("/*"), "{}: build.rs removes comments of `//` only", file.display());
            found.extend(faults(&source).iter().map(|fault| format!("{}: {fault}", file.display())));
            read += 1;
        }
    }
    assert!(read > 50, "only {read} shaders");
    assert!(found.is_empty(), "{}", found.join("\n"));
}
