//! Values of a TOML text over a configuration, one by one. The error names the first bad value with its line.

use super::Configuration;
use crate::toml_file::at_line;
use elunar_base::{Error, Result};
use serde_json::{Value, json};
use std::path::Path;
use toml::Spanned;
use toml::de::DeValue;

/// A configuration that is being changed by a text.
pub(super) struct Overlay<'a> {
    path: &'a Path,
    text: &'a str,
    configuration: Configuration,
    value: Value,
}

impl<'a> Overlay<'a> {
    pub(super) fn new(path: &'a Path, text: &'a str, configuration: Configuration) -> Self {
        let value = json!(configuration);
        Self { path, text, configuration, value }
    }

    /// Returns the configuration. Warm-up takes at most half of the steps.
    pub(super) fn finish(self) -> Configuration {
        let mut made = self.configuration;
        made.recipe.warm_up = made.recipe.warm_up.min(made.recipe.steps / 2);
        made
    }

    /// Sets `key` in the table at `place`.
    pub(super) fn set(
        &mut self,
        place: &mut Vec<String>,
        key: &str,
        offset: usize,
        given: &Spanned<DeValue>,
    ) -> Result<()> {
        place.push(key.into());
        let dotted = place.join(".");
        let unknown = at_line(self.path, self.text, offset, &format!("unknown key {dotted}"));
        if ["name", "answers", "like", "changes"].contains(&dotted.as_str()) {
            return Err(unknown);
        }
        // For data of another kind than the base's, start from an empty value of that kind.
        if let (["data" | "validation_data"], Some(table)) = (&*parts(place), given.get_ref().as_table()) {
            let empty = [json!({"folder": {"path": ""}}), json!({"prepared": {"path": "", "split": "train"}})];
            let kind = |v: &Value| v.as_object().is_some_and(|v| v.keys().all(|k| table.contains_key(k.as_str())));
            let moon = || Some(self.value["data"].clone()).filter(kind);
            if let Some(other) = empty.into_iter().find(kind).or_else(moon)
                && let Some(slot) = self.slot(place)
                && !kind(slot)
            {
                *slot = other;
            }
        }
        if self.slot(place).is_none() {
            return Err(unknown);
        }
        match (given.get_ref().as_table(), self.slot(place)) {
            (Some(table), Some(Value::Object(_))) => {
                for (key, value) in table.iter() {
                    self.set(place, key.get_ref(), key.span().start, value)?;
                }
            }
            _ => self.leaf(place, offset, given)?,
        }
        place.pop();
        Ok(())
    }

    fn leaf(&mut self, place: &[String], offset: usize, given: &Spanned<DeValue>) -> Result<()> {
        let dotted = place.join(".");
        let new = plain(given.get_ref());
        let Some(slot) = self.slot(place) else { return Ok(()) };
        let old = std::mem::replace(slot, new.clone());
        let changes = std::mem::take(&mut self.configuration.changes);
        self.configuration = serde_json::from_value(self.value.clone())
            .map_err(|e| at_line(self.path, self.text, offset, &format!("{dotted}: {e}")))?;
        self.configuration.changes = changes;
        // Compared as numbers: 1 and 1.0 are equal.
        let same = old == new || old.as_f64().zip(new.as_f64()).is_some_and(|(old, new)| old == new);
        if !same {
            self.configuration.changes.push(format!("{dotted} = {new}"));
        }
        Ok(())
    }

    fn slot(&mut self, place: &[String]) -> Option<&mut Value> {
        place.iter().try_fold(&mut self.value, |value, key| value.as_object_mut()?.get_mut(key))
    }
}

fn parts(place: &[String]) -> Vec<&str> {
    place.iter().map(String::as_str).collect()
}

/// Returns what is wrong, without the place: of `--set` the user sees the text anyway.
pub(super) fn reason(error: &Error) -> String {
    let text = error.to_string();
    text.rsplit_once("line 1: ").map_or(text.clone(), |(_, reason)| reason.into())
}

/// Converts a TOML value to JSON. Dates, which no setting uses, become text.
fn plain(value: &DeValue) -> Value {
    let text = |number: &str| number.replace('_', "").parse::<f64>();
    match value {
        DeValue::String(text) => json!(text),
        DeValue::Integer(number) => {
            let digits = number.as_str().replace('_', "");
            u64::from_str_radix(&digits, number.radix()).map_or_else(
                |_| i64::from_str_radix(&digits, number.radix()).map_or(Value::Null, Value::from),
                Value::from,
            )
        }
        DeValue::Float(number) => text(number.as_str()).map_or(Value::Null, Value::from),
        DeValue::Boolean(flag) => json!(flag),
        DeValue::Datetime(date) => json!(date.to_string()),
        DeValue::Array(items) => items.iter().map(|item| plain(item.get_ref())).collect(),
        DeValue::Table(table) => {
            Value::Object(table.iter().map(|(key, v)| (key.get_ref().to_string(), plain(v.get_ref()))).collect())
        }
    }
}
