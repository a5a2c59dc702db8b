//! Rows of figures by name, from JSON or CSV.
//!
//! Figures are kept as text, so that equal figures stay equal.

use anyhow::Context as _;
use serde_json::Value;

use crate::csv_text::csv_text;

/// Name of the column with the command's label.
const LABEL: &str = "label";

/// A table of figures.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rows {
    /// Names of the columns.
    pub columns: Vec<String>,
    /// Rows with one figure per column; empty text for a missing figure.
    pub rows: Vec<Vec<String>>,
}

impl Rows {
    /// Rows of JSON objects or arrays of objects, possibly several in sequence. Fields of nested objects are named
    /// `outer.inner`, elements of arrays `outer.0`.
    ///
    /// # Errors
    /// Text that is not an object or array of objects.
    pub fn from_json(text: &str) -> anyhow::Result<Self> {
        let mut objects = Vec::new();
        for value in serde_json::Deserializer::from_str(text).into_iter() {
            match value.context("no JSON")? {
                Value::Array(some) => objects.extend(some),
                object => objects.push(object),
            }
        }
        anyhow::ensure!(!text.trim().is_empty(), "no JSON: it is empty");
        Self::of(&objects)
    }

    /// The rows of the array in a field of an object.
    ///
    /// # Errors
    /// Text that is not an object with such a field.
    pub fn from_field(text: &str, field: &str) -> anyhow::Result<Self> {
        let object: Value = serde_json::from_str(text).context("no JSON")?;
        let list = object.get(field).and_then(Value::as_array);
        Self::of(list.with_context(|| format!("there is no list {field}"))?)
    }

    fn of(objects: &[Value]) -> anyhow::Result<Self> {
        let mut all = Self::default();
        for object in objects {
            anyhow::ensure!(object.is_object(), "not an object: {object}");
            let mut fields = Vec::new();
            flatten("", object, &mut fields);
            for (name, _) in &fields {
                if !all.columns.contains(name) {
                    all.columns.push(name.clone());
                }
            }
            let of = |name: &String| fields.iter().find(|f| f.0 == *name).map(|f| f.1.clone());
            all.rows.push(all.columns.iter().map(|name| of(name).unwrap_or_default()).collect());
        }
        for row in &mut all.rows {
            row.resize(all.columns.len(), String::new());
        }
        Ok(all)
    }

    /// Rows of comma-separated values; values with commas are quoted, with doubled quotation marks.
    ///
    /// # Errors
    /// Rows of different lengths.
    pub fn from_csv(text: &str) -> anyhow::Result<Self> {
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let words = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<_>>();
        let columns = words(reader.headers().context("no CSV")?);
        anyhow::ensure!(!columns.is_empty(), "no CSV: it is empty");
        let rows = reader.records().map(|record| Ok(words(&record.context("no CSV")?)));
        Ok(Self { rows: rows.collect::<anyhow::Result<_>>()?, columns })
    }

    /// The rows as CSV.
    #[must_use]
    pub fn to_csv(&self) -> String {
        csv_text(std::iter::once(&self.columns).chain(&self.rows))
    }

    /// Index of a column.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c == name)
    }

    /// Index of a required column.
    pub(crate) fn place(&self, name: &str) -> anyhow::Result<usize> {
        self.column(name).with_context(|| format!("there is no column {name}"))
    }

    /// Appends the named columns of other rows, with a label.
    pub(crate) fn extend(&mut self, label: &str, columns: &[String], new: &Self) -> anyhow::Result<()> {
        if self.columns.is_empty() {
            self.columns.push(LABEL.to_owned());
            self.columns.extend_from_slice(columns);
        }
        let place = |name: &String| new.column(name).with_context(|| format!("there is no figure {name}"));
        let places = columns.iter().map(place).collect::<anyhow::Result<Vec<_>>>()?;
        for row in &new.rows {
            let figures = places.iter().map(|&p| row[p].clone());
            self.rows.push(std::iter::once(label.to_owned()).chain(figures).collect());
        }
        Ok(())
    }
}

fn flatten(name: &str, value: &Value, fields: &mut Vec<(String, String)>) {
    let within = |inner: &str| if name.is_empty() { inner.to_owned() } else { format!("{name}.{inner}") };
    match value {
        Value::Object(object) => object.iter().for_each(|(k, v)| flatten(&within(k), v, fields)),
        Value::Array(array) => {
            array.iter().enumerate().for_each(|(i, v)| flatten(&within(&i.to_string()), v, fields));
        }
        Value::Null => fields.push((name.to_owned(), String::new())),
        Value::String(text) => fields.push((name.to_owned(), text.clone())),
        other => fields.push((name.to_owned(), other.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_json_becomes_rows_with_dotted_names() {
        let rows =
            Rows::from_json(r#"[{"a": 1, "b": {"c": 0.25, "d": [7, null]}}, {"a": "x, y", "e": true}]"#)
                .unwrap();
        assert_eq!(rows.columns, ["a", "b.c", "b.d.0", "b.d.1", "e"]);
        assert_eq!(rows.rows[0], ["1", "0.25", "7", "", ""]);
        assert_eq!(rows.rows[1], ["x, y", "", "", "", "true"]);
        assert!(Rows::from_json("3").is_err() && Rows::from_json("{").is_err());
        assert!(Rows::from_json("\n").is_err() && Rows::from_json("{\"a\": 1}\n{\"a\"").is_err());
        let lines = Rows::from_json("{\"a\": 1}\n{\"a\": 2}\n").unwrap();
        assert_eq!(lines.rows, [["1"], ["2"]]);
        let inner = Rows::from_field(r#"{"a": 1, "b": [{"c": 2}, {"c": 3}]}"#, "b").unwrap();
        assert_eq!(
            (inner.columns, inner.rows),
            (vec!["c".to_owned()], vec![vec!["2".to_owned()], vec!["3".to_owned()]])
        );
        assert!(Rows::from_field(r#"{"a": 1}"#, "a").is_err());
    }

    #[test]
    fn csv_round_trips() {
        let rows = Rows {
            columns: vec!["a".to_owned(), "b".to_owned()],
            rows: vec![
                vec!["2 Mbit/s, \"fast\"".to_owned(), String::new()],
                vec!["1".to_owned(), "2".to_owned()],
            ],
        };
        assert_eq!(Rows::from_csv(&rows.to_csv()).unwrap(), rows);
        for (text, why) in [("a,b\n1\n", "1 fields"), ("", "empty")] {
            let error = format!("{:#}", Rows::from_csv(text).unwrap_err());
            assert!(error.contains(why), "{error}");
        }
    }

    #[test]
    fn a_missing_figure_is_named() {
        let new = Rows::from_json(r#"{"a": 1}"#).unwrap();
        let mut rows = Rows::default();
        let error = rows.extend("x", &["b".to_owned()], &new).unwrap_err();
        assert!(error.to_string().contains("no figure b"));
        let mut rows = Rows::default();
        rows.extend("x", &["a".to_owned()], &new).unwrap();
        assert_eq!(rows.to_csv(), "label,a\nx,1\n");
    }
}
