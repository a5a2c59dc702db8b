//! Comma-separated values (RFC 4180, with plain line feeds).

/// Writes lines of fields; quotes fields with a comma, a quotation mark or a line break.
pub(crate) fn csv_text<L>(lines: impl IntoIterator<Item = L>) -> String
where
    L: IntoIterator<Item: AsRef<[u8]>>,
{
    let mut writer = csv::WriterBuilder::new().flexible(true).from_writer(Vec::new());
    for line in lines {
        writer.write_record(line).expect("writing to memory does not fail");
    }
    let bytes = writer.into_inner().expect("writing to memory does not fail");
    String::from_utf8(bytes).expect("fields are text")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_with_commas_and_quotes_are_quoted() {
        let lines = [["a", "b", "c"], ["x, \"y\"", "", "1.5"], ["two\nlines", " ", "–"]];
        assert_eq!(csv_text(lines), "a,b,c\n\"x, \"\"y\"\"\",,1.5\n\"two\nlines\", ,–\n");
        assert_eq!(csv_text([[""; 0]; 0]), "");
    }
}
