//! Changes of a plan's keys from the command line.

use toml::{Table, Value};

use super::Fault;

/// The text of a plan with changes, each `KEY=VALUE`; a dot leads into a table, which is created if missing.
/// Changes within a list of tables (`sweep`) apply to each of its tables.
pub(super) fn changed(text: &str, changes: &[String]) -> Result<String, Fault> {
    let no_toml = |why: toml::de::Error| Fault::new("", why.message().replace('\n', " "));
    let mut plan: Table = text.parse().map_err(no_toml)?;
    for change in changes {
        let fault = |message: String| Fault::new(change.clone(), message);
        let (key, value) =
            change.split_once('=').ok_or_else(|| fault("is not a change; write KEY=VALUE".to_owned()))?;
        let value = format!("value = {value}").parse::<Table>().ok().and_then(|mut t| t.remove("value"));
        let value = value
            .ok_or_else(|| fault("the value is not valid TOML; words need quotation marks".to_owned()))?;
        let keys: Vec<&str> = key.trim().split('.').collect();
        if keys.iter().any(|key| key.is_empty()) {
            return Err(fault("a key is empty".to_owned()));
        }
        set(&mut plan, &keys, &value).map_err(fault)?;
    }
    toml::to_string(&plan).map_err(|why| Fault::new("", why.to_string()))
}

fn set(table: &mut Table, keys: &[&str], value: &Value) -> Result<(), String> {
    let [key, rest @ ..] = keys else { return Ok(()) };
    if rest.is_empty() {
        table.insert((*key).to_owned(), value.clone());
        return Ok(());
    }
    match table.entry(*key).or_insert_with(|| Value::Table(Table::new())) {
        Value::Table(inner) => set(inner, rest, value),
        Value::Array(list) if list.iter().all(Value::is_table) => {
            list.iter_mut().filter_map(Value::as_table_mut).try_for_each(|inner| set(inner, rest, value))
        }
        _ => Err(format!("{key} is not a table")),
    }
}
