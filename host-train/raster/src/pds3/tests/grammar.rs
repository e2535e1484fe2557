//! The label's grammar.

use super::super::{LabelBlock, Value, ValueKind};
use super::{shared, sldem_label};

fn value(text: &str) -> Value {
    LabelBlock::parse(format!("A = {text}\nEND\n").as_bytes()).unwrap().items.remove(0).value
}

fn defect(text: &[u8]) -> (usize, String) {
    let defect = LabelBlock::parse(text).expect_err(&String::from_utf8_lossy(text));
    (defect.line, defect.what)
}

#[test]
fn values_of_every_kind() {
    let plain = |kind: ValueKind| Value { kind, unit: None };
    let one = || plain(ValueKind::Integer(1));
    assert_eq!(value("1"), one());
    assert_eq!(value("4.5 <KM/S>"), Value { kind: ValueKind::Real(4.5), unit: Some("KM/S".into()) });
    assert_eq!(value("45\n <M**2>").unit.as_deref(), Some("M**2"));
    assert_eq!(value("'N/A'"), plain(ValueKind::Symbol("N/A".into())));
    assert_eq!(value("\"a\r\n  b /* c */ = 'd' END\"").text(), Some("a\r\n  b /* c */ = 'd' END"));
    assert_eq!(value("()").kind, ValueKind::Sequence(vec![]));
    assert_eq!(value("{ }").kind, ValueKind::Set(vec![]));
    assert_eq!(value("{1}").kind, ValueKind::Set(vec![one()]));
    assert_eq!(
        value("(1, (1,1))").kind,
        ValueKind::Sequence(vec![one(), plain(ValueKind::Sequence(vec![one(), one()]))])
    );
    let units = value("(1 <m>,\n /* between */ TWO, \"Three\", 4.0)");
    assert_eq!(units.members()[0].unit.as_deref(), Some("m"));
    assert_eq!(units.members()[1].text(), Some("TWO"));
    assert_eq!(value("2#1111111111111111#").number(), Some(65535.0));
    assert_eq!(value("\n\n  MOON").text(), Some("MOON"));
    // In messages, as in the label, on one line.
    for (text, shown) in [
        ("( 1 <m>, (TWO),\n \"Three\n  lines\" , 4.5)", "(1 <m>, (TWO), Three lines, 4.5)"),
        ("{16#FF#,\t1990-07-04}", "{255 (stated to base 16), 1990-07-04}"),
        ("()", "()"),
    ] {
        assert_eq!(value(text).to_string(), shown);
    }
    assert!(value("UNK").is_absent() && value("'N/A'").is_absent() && !value("MOON").is_absent());
    assert_eq!(value("\"\u{e9}\"").text(), Some("\u{e9}"), "UTF-8");
}

#[test]
fn blocks_nest_and_close_by_name() {
    let label = LabelBlock::parse(
        b"OBJECT=IMAGE /* c */ LINES=1 Object = thing A=2; End_Object END_OBJECT = image\nGROUP=G B=3 END_GROUP ; C=4",
    )
    .unwrap();
    assert_eq!(label.block("IMAGE").unwrap().find("LINES").unwrap().unwrap().value.number(), Some(1.0));
    assert_eq!(label.block("THING").unwrap().items[0].key, "A");
    assert_eq!(label.find("C").unwrap().unwrap().line, 2);
    assert_eq!(label.block("G").unwrap().items.len(), 1);
    let sldem = LabelBlock::parse(sldem_label("S", 3, 4).as_bytes()).unwrap();
    assert_eq!(sldem.block("UNCOMPRESSED_FILE").unwrap().items.len(), 5);
}

#[test]
fn a_keyword_may_have_no_value() {
    let label =
        LabelBlock::parse(b"A =\nB = \r\n\r\n^C = 1\nGROUP = G\n D = /* none */\nEND_GROUP\nE =\nEND\n").unwrap();
    let empty: Vec<(&str, usize)> = label.empty().iter().map(|item| (item.key.as_str(), item.line)).collect();
    assert_eq!(empty, [("A", 1), ("B", 2), ("E", 8), ("D", 6)]);
    assert!(label.find("A").unwrap().is_none() && label.items[0].value.is_absent());
    assert_eq!(label.items[0].value.to_string(), "");
    assert_eq!(LabelBlock::parse(b"A =\nA = 5\nEND").unwrap().find("A").unwrap().unwrap().value.number(), Some(5.0));
    // A value may stand on the next line.
    assert_eq!(LabelBlock::parse(b"A =\n B\nC = 2\nEND").unwrap().items[0].value.text(), Some("B"));
}

#[test]
fn what_follows_the_end_is_not_read() {
    assert_eq!(LabelBlock::parse(b"A = 1\r\nEND\r\n\xFF\x00\"unclosed").unwrap().items.len(), 1);
    assert_eq!(LabelBlock::parse(b"A = 1\n\0\0\0").unwrap().items.len(), 1, "padding");
    assert_eq!(LabelBlock::parse(b"").unwrap(), LabelBlock::default());
}

#[test]
fn defects_have_their_line() {
    let cases: [(&[u8], usize, &str); 20] = [
        (b"A = 1\nB =", 2, "a value of B expected, found the end"),
        (b"A = 1\nB = ;", 2, "a value of B expected, found \";\""),
        (b"A = 1\nB = END", 2, "found \"END\""),
        (b"A 1", 1, "\"=\" behind A expected"),
        (b"\nA = b = c", 2, "a keyword expected, found \"=\""),
        (b"A = #", 1, "16#FF#"),
        (b"A = 2#3#", 1, "16#FF#"),
        (b"OBJECT = X\nA = 1\nEND", 1, "END_OBJECT = X"),
        (b"OBJECT = X\nEND_GROUP = X", 2, "END_OBJECT = X for line 1 expected, found END_GROUP"),
        (b"OBJECT = X\nEND_OBJECT = Y", 2, "found another name"),
        (b"END_OBJECT = Y", 1, "an open block expected"),
        (b"OBJECT = (1)\n", 1, "a name of the OBJECT"),
        (b"A = (1 2)", 1, "\",\" or \")\""),
        (b"A = (1,\n2", 2, "\",\" or \")\" in the list of line 1"),
        (b"A = (1}", 1, "\",\" or \")\""),
        (b"A = \"x\nB = 1", 1, "a text that \" closes"),
        (b"A = 1 <m\n>", 1, "a unit that > closes"),
        (b"\n/* x", 2, "a comment that \"*/\" closes"),
        (b"A = 1\n\xB0 = 2", 2, "0xB0"),
        (b"A = 1\n= 2", 2, "a keyword expected, found \"=\""),
    ];
    for (text, line, what) in cases {
        let (found_line, found) = defect(text);
        assert!(found_line == line && found.contains(what), "{}: {found_line}: {found}", String::from_utf8_lossy(text));
    }
}

#[test]
fn nesting_is_bounded() {
    let (_, what) = defect(&[b"A=".as_slice(), &[b'('; 100_000]].concat());
    assert!(what.contains("32 deep"), "{what}");
    let (_, what) = defect("OBJECT = A\n".repeat(100_000).as_bytes());
    assert!(what.contains("32 deep"), "{what}");
    // Width does not count as depth.
    let wide = format!("A = ({}1)", "(1), ".repeat(1000));
    assert_eq!(LabelBlock::parse(wide.as_bytes()).unwrap().items[0].value.members().len(), 1001);
}

#[test]
fn contradictions_are_found_when_asked_for() {
    let label = LabelBlock::parse(b"A = 1\nA = 1\nB = 1\nB = 2").unwrap();
    assert_eq!(label.find("A").unwrap().unwrap().line, 1);
    assert!(
        label
            .find("B")
            .unwrap_err()
            .to_string()
            .contains("line 4: one value of B expected, found another one than in line 3")
    );
}

#[test]
fn real_labels_and_grammar_cases() {
    let Some(folder) = shared("pds3_labels") else { return };
    let files = |folder: &str| {
        let entries = std::fs::read_dir(shared("pds3_labels").unwrap().join(folder)).unwrap();
        let mut files: Vec<_> = entries.map(|e| e.unwrap().path()).collect();
        files.retain(|path| path.extension().is_some_and(|e| e != "xml") && path.is_file());
        files.sort();
        files
    };
    let mut parsed = 0;
    for path in [files("grammar"), files(".")].concat() {
        let label =
            LabelBlock::parse(&std::fs::read(&path).unwrap()).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert_eq!(label.items[0].key, "PDS_VERSION_ID", "{}", path.display());
        parsed += 1;
    }
    assert_eq!(parsed, 20);
    let times = LabelBlock::parse(&std::fs::read(folder.join("grammar/dates.lbl")).unwrap()).unwrap();
    assert!(times.items[1..].iter().all(|item| matches!(item.value.kind, ValueKind::Time(_))), "{times:?}");
    let sets = LabelBlock::parse(&std::fs::read(folder.join("grammar/set1.lbl")).unwrap()).unwrap();
    assert_eq!(sets.items[3].value.members().len(), 3);

    let mut broken: Vec<(String, usize)> = Vec::new();
    for path in files("grammar/broken") {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        if let Err(defect) = LabelBlock::parse(&std::fs::read(&path).unwrap()) {
            broken.push((name, defect.line));
        }
    }
    // The missing cases are read here: keywords without a value, and a degree sign in Latin-1.
    let expected = [("13", 1), ("15", 4), ("2", 2), ("4", 3), ("6", 3)];
    let expected: Vec<_> = expected.iter().map(|(name, line)| (format!("broken{name}"), *line)).collect();
    assert_eq!(broken, expected);
}

#[test]
fn transfer_labels_of_older_volumes_are_skipped() {
    let text = b"CCSD3ZF0000100000001NJPL3IF0PDSX00000001\r\nNJPL1I00PDS100000000 = SFDU_LABEL\r\nA = 1\r\nB = ;";
    assert_eq!(defect(text), (4, "a value of B expected, found \";\"".into()));
    assert_eq!(LabelBlock::parse(&text[..text.len() - 3]).unwrap_err().line, 4);
    assert_eq!(LabelBlock::parse(b"CCSD3ZF0000100000001").unwrap(), LabelBlock::default(), "nothing follows");
}
