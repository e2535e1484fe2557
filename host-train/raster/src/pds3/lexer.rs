//! Tokens of a label, from bytes: the words of PVL and of its stricter form ODL, with their lines.

use super::Defect;
use std::fmt;

/// A word of the label.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    /// An unquoted word: keyword, number, date or symbol.
    Word(String),
    /// `"..."`, without the quotes, lines kept.
    Text(String),
    /// `'...'`, without the quotes.
    Symbol(String),
    /// `<...>`, without the brackets.
    Unit(String),
    /// One of `= ( ) { } , ;`.
    Mark(u8),
    /// End of the label.
    End,
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let short = |text: &str| text.chars().take(40).collect::<String>();
        match self {
            Self::Word(word) => write!(f, "{:?}", short(word)),
            Self::Text(text) => write!(f, "the text {:?}", short(text)),
            Self::Symbol(text) => write!(f, "the symbol {:?}", short(text)),
            Self::Unit(unit) => write!(f, "the unit <{}>", short(unit)),
            Self::Mark(mark) => write!(f, "\"{}\"", *mark as char),
            Self::End => f.write_str("the end of the label"),
        }
    }
}

/// Reads tokens one after the other. To look ahead, a copy is used.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lexer<'a> {
    bytes: &'a [u8],
    at: usize,
    line: usize,
}

impl<'a> Lexer<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut lexer = Self { bytes, at: 0, line: 1 };
        lexer.skip_transfer_labels();
        lexer
    }

    /// Returns the line, counted from 1, of the next token.
    pub(super) fn line(&mut self) -> Result<usize, Defect> {
        self.skip_blanks()?;
        Ok(self.line)
    }

    /// Returns the next token. A NUL byte ends the label, as the end of the file does, because labels are padded with it.
    pub(super) fn next(&mut self) -> Result<Token, Defect> {
        self.skip_blanks()?;
        match self.peek() {
            None | Some(0) => Ok(Token::End),
            Some(mark @ (b'=' | b'(' | b')' | b'{' | b'}' | b',' | b';')) => {
                self.at += 1;
                Ok(Token::Mark(mark))
            }
            Some(b'"') => self.enclosed(b'"', "text").map(Token::Text),
            Some(b'\'') => self.enclosed(b'\'', "symbol").map(Token::Symbol),
            Some(b'<') => self.enclosed(b'>', "unit").map(|unit| Token::Unit(unit.trim().into())),
            Some(_) => self.word().map(Token::Word),
        }
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn starts_with(&self, text: &[u8]) -> bool {
        self.bytes[self.at..].starts_with(text)
    }

    /// Skips the lines of standard formatted data units around older labels, such as `CCSD3ZF0000100000001NJPL3IF0PDSX00000001`.
    fn skip_transfer_labels(&mut self) {
        while self.starts_with(b"CCSD") || self.starts_with(b"NJPL") {
            let line =
                self.bytes[self.at..].iter().position(|&b| b == b'\n').map_or(self.bytes.len(), |n| self.at + n + 1);
            (self.at, self.line) = (line, self.line + 1);
        }
    }

    fn skip_blanks(&mut self) -> Result<(), Defect> {
        while let Some(byte) = self.peek() {
            if self.starts_with(b"/*") {
                let start = self.line;
                let Some(length) = find(&self.bytes[self.at + 2..], b"*/") else {
                    return Err(Defect::at(
                        start,
                        "a comment that \"*/\" closes expected, found none to the end of the label",
                    ));
                };
                self.advance(length + 4);
            } else if byte.is_ascii_whitespace() || byte == 0x0b {
                self.advance(1);
            } else {
                break;
            }
        }
        Ok(())
    }

    /// Advances by `count` bytes and counts lines.
    fn advance(&mut self, count: usize) {
        self.line += self.bytes[self.at..self.at + count].iter().filter(|&&b| b == b'\n').count();
        self.at += count;
    }

    /// Returns the text between the mark here and the next `close`. Units end on their line; texts may have any length.
    fn enclosed(&mut self, close: u8, what: &str) -> Result<String, Defect> {
        let rest = &self.bytes[self.at + 1..];
        let rest = if close == b'>' { rest.split(|&b| b == b'\n').next().unwrap_or(&[]) } else { rest };
        let Some(length) = rest.iter().position(|&b| b == close) else {
            let close = close as char;
            return Err(Defect::at(self.line, format!("a {what} that {close} closes expected, found no end of it")));
        };
        let text = decode(&rest[..length]);
        self.advance(length + 2);
        Ok(text)
    }

    fn word(&mut self) -> Result<String, Defect> {
        let start = self.at;
        while let Some(byte) = self.peek() {
            let ends =
                byte.is_ascii_whitespace() || b"=(){},;<>\"'".contains(&byte) || byte < b' ' || self.starts_with(b"/*");
            if ends {
                break;
            }
            if !byte.is_ascii_graphic() {
                return Err(Defect::at(
                    self.line,
                    format!("printable ASCII outside quoted text expected, found byte 0x{byte:02X}"),
                ));
            }
            self.at += 1;
        }
        if self.at == start {
            let byte = self.bytes[start];
            return Err(Defect::at(self.line, format!("a word expected, found byte 0x{byte:02X}")));
        }
        Ok(decode(&self.bytes[start..self.at]))
    }
}

/// Decodes bytes as UTF-8, otherwise as Latin-1, which older labels use. Labels are ASCII by their standard.
fn decode(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&b| b as char).collect(),
    }
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|window| window == what)
}
