//! The XML of tag 42112 (GDAL_METADATA): items with a name and, for the band, a role.

/// One `<Item>`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Item {
    /// Attribute `name`.
    pub(super) name: String,
    /// Attribute `role` (`scale`, `offset`, `unittype`, `description`), empty for free items.
    pub(super) role: String,
    /// The band that a role belongs to, counted from 0.
    pub(super) band: usize,
    /// The text between the tags, unescaped.
    pub(super) text: String,
}

/// Reads the items of the first band and of the whole file. Other items are skipped.
pub(super) fn parse(xml: &str) -> Vec<Item> {
    let mut items = Vec::new();
    let mut rest = xml;
    while let Some(at) = rest.find("<Item ") {
        rest = &rest[at + 6..];
        let (Some(open), Some(close)) = (rest.find('>'), rest.find("</Item>")) else { break };
        if open < close {
            let (head, text) = (&rest[..open], &rest[open + 1..close]);
            let attribute = |name: &str| attribute(head, name);
            if attribute("sample").is_none_or(|sample| sample == "0") {
                let (name, role) = (attribute("name").unwrap_or_default(), attribute("role").unwrap_or_default());
                items.push(Item { name, role, band: 0, text: unescape(text) });
            }
        }
        rest = &rest[close + 7..];
    }
    items
}

/// Writes `items` as GDAL does. Roles belong to a band.
pub(super) fn format(items: &[Item]) -> String {
    let mut xml = String::from("<GDALMetadata>\n");
    for item in items {
        let role = match item.role.as_str() {
            "" => String::new(),
            role => format!(" sample=\"{}\" role=\"{}\"", item.band, escape(role)),
        };
        xml += &format!("  <Item name=\"{}\"{role}>{}</Item>\n", escape(&item.name), escape(&item.text));
    }
    xml + "</GDALMetadata>\n"
}

fn attribute(head: &str, name: &str) -> Option<String> {
    let start = head.find(&format!("{name}=\""))? + name.len() + 2;
    let length = head[start..].find('"')?;
    Some(unescape(&head[start..start + length]))
}

/// Escapes mark-up and everything except printable ASCII, which the tag cannot hold.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            ' '..='~' => out.push(c),
            // XML 1.0 allows no other control characters, not even escaped.
            '\n' | '\t' => out += &format!("&#{};", c as u32),
            c if c.is_control() => out.push('?'),
            c => out += &format!("&#{};", c as u32),
        }
    }
    out
}

fn unescape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('&') {
        out += &rest[..at];
        rest = &rest[at..];
        let Some(end) = rest.find(';') else { break };
        match character(&rest[1..end]) {
            Some(c) => out.push(c),
            None => out += &rest[..=end],
        }
        rest = &rest[end + 1..];
    }
    out + rest
}

fn character(entity: &str) -> Option<char> {
    match entity {
        "amp" => Some('&'),
        "lt" => Some('<'),
        "gt" => Some('>'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        _ => {
            let digits = entity.strip_prefix('#')?;
            let code = match digits.strip_prefix(['x', 'X']) {
                Some(hex) => u32::from_str_radix(hex, 16),
                None => digits.parse(),
            };
            char::from_u32(code.ok()?)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let items = vec![
            Item { name: "UNITTYPE".into(), role: "unittype".into(), band: 0, text: "m".into() },
            Item { name: "MODEL".into(), role: String::new(), band: 0, text: "a<b> & \"c\"\nmünchen".into() },
        ];
        let xml = format(&items);
        assert!(xml.is_ascii());
        assert_eq!(parse(&xml), items);
    }

    #[test]
    fn other_bands_and_broken_mark_up_are_skipped() {
        let xml = "<GDALMetadata><Item name=\"SCALE\" sample=\"1\" role=\"scale\">9</Item><Item name=\"A\">x &bogus; y</Item><Item name=";
        let items = parse(xml);
        assert_eq!(items.len(), 1);
        assert_eq!((items[0].name.as_str(), items[0].text.as_str()), ("A", "x &bogus; y"));
        // An entity without an end, characters by their numbers, and one that no XML can hold.
        let text = |xml: &str| parse(xml)[0].text.clone();
        assert_eq!(text("<Item name=\"A\">x &amp y</Item>"), "x &amp y");
        assert_eq!(text("<Item name=\"A\">&#x41;&#66;&lt;&gt;&quot;&apos;</Item>"), "AB<>\"'");
        let bell = Item { name: "A".into(), role: String::new(), band: 0, text: "x\u{7}y".into() };
        assert_eq!(text(&format(&[bell])), "x?y");
    }
}
