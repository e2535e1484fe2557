//! Presets: configuration documents that are built in (`host-train/models/presets`).

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Named configurations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The paper's network, 321 M parameters.
    Paper,
    /// Half the width.
    Small,
    /// A quarter of the width.
    Tiny,
    /// An eighth of the width, 2.8 M parameters. A laptop can train it, and a microcontroller can run it.
    Nano,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 4] = [Self::Paper, Self::Small, Self::Tiny, Self::Nano];

    /// Returns the name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Small => "small",
            Self::Tiny => "tiny",
            Self::Nano => "nano",
        }
    }

    /// The preset that this one differs from, and what differs.
    fn parts(self) -> (Option<Self>, &'static str) {
        match self {
            Self::Paper => (None, include_str!("../../models/presets/paper.toml")),
            Self::Small => (Some(Self::Paper), include_str!("../../models/presets/small.toml")),
            Self::Tiny => (Some(Self::Nano), include_str!("../../models/presets/tiny.toml")),
            Self::Nano => (Some(Self::Paper), include_str!("../../models/presets/nano.toml")),
        }
    }

    /// Returns the whole document: tables `network`, `recipe`, `data` and `evaluation`.
    ///
    /// # Panics
    /// If the document that is built in is no TOML: a test reads all of them.
    #[must_use]
    pub fn document(self) -> Value {
        let (base, text) = self.parts();
        let own: Value = toml::from_str(text).unwrap_or_else(|e| panic!("preset {}: {e}", self.name()));
        match base {
            Some(base) => overlaid(base.document(), own),
            None => own,
        }
    }

    /// Returns a table of the document.
    ///
    /// # Panics
    /// As [`Self::document`], or if the table is not of this type.
    #[must_use]
    pub fn table<T: DeserializeOwned>(self, name: &str) -> T {
        let table = self.document().get(name).cloned().unwrap_or_default();
        serde_json::from_value(table).unwrap_or_else(|e| panic!("preset {}: {name}: {e}", self.name()))
    }
}

/// Returns `base` with the values of `over`. Tables are joined, all other values replaced.
#[must_use]
pub fn overlaid(base: Value, over: Value) -> Value {
    match (base, over) {
        (Value::Object(mut base), Value::Object(over)) => {
            for (key, value) in over {
                let old = base.remove(&key).unwrap_or_default();
                base.insert(key, overlaid(old, value));
            }
            Value::Object(base)
        }
        (_, over) => over,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn tables_are_joined_and_values_replaced() {
        let base = json!({"a": {"b": 1, "c": [1, 2]}, "d": null});
        let found = overlaid(base, json!({"a": {"c": [3]}, "d": {"e": 2}}));
        assert_eq!(found, json!({"a": {"b": 1, "c": [3]}, "d": {"e": 2}}));
    }

    #[test]
    fn every_preset_states_keys_of_the_papers_alone() {
        fn keys(value: &Value, place: &str, out: &mut Vec<String>) {
            match value.as_object() {
                Some(table) => table.iter().for_each(|(key, value)| keys(value, &format!("{place}.{key}"), out)),
                None => out.push(place.into()),
            }
        }
        let of = |preset: Preset| {
            let mut out = vec![];
            keys(&preset.document(), "", &mut out);
            out
        };
        for preset in Preset::ALL {
            assert_eq!(of(preset), of(Preset::Paper), "{}", preset.name());
        }
    }
}
