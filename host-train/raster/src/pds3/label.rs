//! The tree of a label, from tokens.
//!
//! The grammar is PVL (CCSDS 641.0-B-2) as PDS3 labels use it (PDS Standards Reference, chapter 12). It is lenient where real labels differ
//! from the standard, and strict where the meaning would have to be guessed. Errors: a value missing on the keyword's line or at the end, a
//! word without equals sign, a block closed under another name. Not errors: a keyword whose next line is another statement, which is empty;
//! Latin-1 bytes in texts, comments over several lines, a missing `END` at the end of the file, and statements closed by `;`.

use super::Defect;
use super::lexer::{Lexer, Token};
use super::value::{Value, ValueKind, classify};

/// Greatest depth of nested blocks and sequences. Real labels need four.
const MOST_NESTING: usize = 32;

/// One level of a label: the label itself, an OBJECT or a GROUP.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelBlock {
    /// Name of the OBJECT or GROUP in capitals; empty for the label itself.
    pub name: String,
    /// `KEY = value` in the order of the file.
    pub items: Vec<LabelItem>,
    /// Blocks within this block, in the order of the file.
    pub blocks: Vec<LabelBlock>,
}

/// `KEY = value`.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelItem {
    /// The keyword in capitals. A pointer begins with `^`.
    pub key: String,
    /// Value of the keyword.
    pub value: Value,
    /// Line of the keyword, counted from 1.
    pub line: usize,
}

impl LabelBlock {
    /// Reads a label from the beginning of `bytes` to its `END`, which may be missing.
    ///
    /// # Errors
    /// [`Defect`] with the line, and what was expected and found there.
    pub fn parse(bytes: &[u8]) -> Result<Self, Defect> {
        let mut label = Self::default();
        Parser { lexer: Lexer::new(bytes), depth: 0 }.block(&mut label, None)?;
        Ok(label)
    }

    /// Returns the keywords without a value, in this block and those within it.
    #[must_use]
    pub fn empty(&self) -> Vec<&LabelItem> {
        let here = self.items.iter().filter(|item| item.value.kind == ValueKind::Empty);
        here.chain(self.blocks.iter().flat_map(Self::empty)).collect()
    }

    /// Returns the item of `key` (in capitals) in this block itself. Words for "no value" count as none, and so does an empty keyword.
    ///
    /// # Errors
    /// [`Defect`] if the key is stated twice, with different values.
    pub fn find(&self, key: &str) -> Result<Option<&LabelItem>, Defect> {
        let mut stated = self.items.iter().filter(|item| item.key == key && item.value.kind != ValueKind::Empty);
        let first = stated.next();
        if let (Some(first), Some(other)) = (first, stated.find(|item| Some(&item.value) != first.map(|f| &f.value))) {
            let what = format!("one value of {key} expected, found another one than in line {}", first.line);
            return Err(Defect::at(other.line, what));
        }
        Ok(first.filter(|item| !item.value.is_absent()))
    }

    /// Returns the first block of that name (in capitals), at any depth.
    #[must_use]
    pub fn block(&self, name: &str) -> Option<&LabelBlock> {
        self.blocks.iter().find_map(|block| if block.name == name { Some(block) } else { block.block(name) })
    }
}

struct Parser<'a> {
    lexer: Lexer<'a>,
    depth: usize,
}

impl Parser<'_> {
    /// Reads statements up to the end of the block. `opened` is the line and the word that opened it.
    fn block(&mut self, block: &mut LabelBlock, opened: Option<(usize, &str)>) -> Result<(), Defect> {
        loop {
            let line = self.lexer.line()?;
            let word = match self.lexer.next()? {
                Token::Mark(b';') => continue,
                Token::Word(word) => word,
                Token::End => return unclosed(block, opened),
                other => return Err(Defect::at(line, format!("a keyword expected, found {other}"))),
            };
            let key = word.to_ascii_uppercase();
            match key.as_str() {
                "END" => return unclosed(block, opened),
                "END_OBJECT" | "END_GROUP" => return self.close(block, &key, line, opened),
                "OBJECT" | "GROUP" | "BEGIN_OBJECT" | "BEGIN_GROUP" => self.open(block, &key, line)?,
                _ => {
                    if !is_keyword(&key) {
                        return Err(Defect::at(line, format!("a keyword expected, found {word:?}")));
                    }
                    self.equals(&word, line)?;
                    let value = match self.is_empty(line)? {
                        true => Value { kind: ValueKind::Empty, unit: None },
                        false => self.value(&key, line)?,
                    };
                    block.items.push(LabelItem { key, value, line });
                }
            }
        }
    }

    /// Returns whether the next line's statement follows the equals sign of a keyword at `line`.
    fn is_empty(&mut self, line: usize) -> Result<bool, Defect> {
        let below = self.lexer.line()? > line;
        let mut ahead = self.lexer;
        Ok(below
            && matches!(ahead.next()?, Token::Word(word) if is_reserved(&word) || matches!(ahead.next(), Ok(Token::Mark(b'=')))))
    }

    fn equals(&mut self, word: &str, line: usize) -> Result<(), Defect> {
        match self.lexer.next()? {
            Token::Mark(b'=') => Ok(()),
            other => Err(Defect::at(line, format!("\"=\" behind {word} expected, found {other}"))),
        }
    }

    fn open(&mut self, parent: &mut LabelBlock, word: &str, line: usize) -> Result<(), Defect> {
        self.equals(word, line)?;
        let value = self.value(word, line)?;
        let Some(name) = value.text() else {
            return Err(Defect::at(line, format!("a name of the {word} expected, found {:?}", value.kind)));
        };
        let mut block = LabelBlock { name: name.to_ascii_uppercase(), ..LabelBlock::default() };
        self.deeper(line)?;
        self.block(&mut block, Some((line, word.trim_start_matches("BEGIN_"))))?;
        self.depth -= 1;
        parent.blocks.push(block);
        Ok(())
    }

    /// Reads the name behind `END_OBJECT` or `END_GROUP`. If given, it must be the block's name.
    fn close(
        &mut self,
        block: &LabelBlock,
        word: &str,
        line: usize,
        opened: Option<(usize, &str)>,
    ) -> Result<(), Defect> {
        let Some((opened_line, opened_word)) = opened else {
            return Err(Defect::at(line, format!("an open block expected, found {word}")));
        };
        let open = format!("END_{opened_word} = {} for line {opened_line}", block.name);
        if word != format!("END_{opened_word}") {
            return Err(Defect::at(line, format!("{open} expected, found {word}")));
        }
        let mut ahead = self.lexer;
        if ahead.next()? == Token::Mark(b'=') {
            self.lexer = ahead;
            let value = self.value(word, line)?;
            if !value.text().is_some_and(|name| name.eq_ignore_ascii_case(&block.name)) {
                return Err(Defect::at(line, format!("{open} expected, found another name")));
            }
        }
        Ok(())
    }

    /// Reads the value behind `key`'s equals sign, with its unit.
    fn value(&mut self, key: &str, line: usize) -> Result<Value, Defect> {
        let missing = |found: &Token| Defect::at(line, format!("a value of {key} expected, found {found}"));
        let here = self.lexer.line()?;
        let kind = match self.lexer.next()? {
            Token::Word(word) if is_reserved(&word) => return Err(missing(&Token::Word(word))),
            Token::Word(word) => classify(&word).map_err(|what| Defect::at(here, what))?,
            Token::Text(text) => ValueKind::Text(text),
            Token::Symbol(text) => ValueKind::Symbol(text),
            Token::Mark(b'(') => ValueKind::Sequence(self.members(key, b')', here)?),
            Token::Mark(b'{') => ValueKind::Set(self.members(key, b'}', here)?),
            other => return Err(missing(&other)),
        };
        let mut ahead = self.lexer;
        let unit = match ahead.next() {
            Ok(Token::Unit(unit)) => {
                self.lexer = ahead;
                Some(unit)
            }
            // A defect behind the value belongs to the next statement, which will find it again.
            _ => None,
        };
        Ok(Value { kind, unit })
    }

    fn members(&mut self, key: &str, close: u8, opened: usize) -> Result<Vec<Value>, Defect> {
        self.deeper(opened)?;
        let mut members = Vec::new();
        let mut ahead = self.lexer;
        if ahead.next()? == Token::Mark(close) {
            self.lexer = ahead;
            self.depth -= 1;
            return Ok(members);
        }
        loop {
            let line = self.lexer.line()?;
            members.push(self.value(key, line)?);
            let line = self.lexer.line()?;
            match self.lexer.next()? {
                Token::Mark(b',') => {}
                Token::Mark(mark) if mark == close => break,
                other => {
                    let what =
                        format!("\",\" or \"{}\" in the list of line {opened} expected, found {other}", close as char);
                    return Err(Defect::at(line, what));
                }
            }
        }
        self.depth -= 1;
        Ok(members)
    }

    fn deeper(&mut self, line: usize) -> Result<(), Defect> {
        self.depth += 1;
        if self.depth > MOST_NESTING {
            return Err(Defect::at(line, format!("blocks and lists at most {MOST_NESTING} deep expected, found more")));
        }
        Ok(())
    }
}

fn unclosed(block: &LabelBlock, opened: Option<(usize, &str)>) -> Result<(), Defect> {
    match opened {
        None => Ok(()),
        Some((line, word)) => {
            let what =
                format!("END_{word} = {} for the {word} opened here expected, found the end of the label", block.name);
            Err(Defect::at(line, what))
        }
    }
}

fn is_keyword(key: &str) -> bool {
    let name = key.strip_prefix('^').unwrap_or(key);
    name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"_:.-/".contains(&b))
}

fn is_reserved(word: &str) -> bool {
    let reserved = ["END", "END_OBJECT", "END_GROUP", "OBJECT", "GROUP", "BEGIN_OBJECT", "BEGIN_GROUP"];
    reserved.iter().any(|other| other.eq_ignore_ascii_case(word))
}
