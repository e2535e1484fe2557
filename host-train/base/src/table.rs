//! Tables as text, one row per line. The `csv` crate reads them with line numbers and writes them as CSV.

use crate::{Error, Result};
use csv::{ByteRecord, StringRecord, Terminator};
use std::io::{Chain, Read};
use std::path::Path;

/// The rows of a text, with cells between commas. Empty lines and lines that begin with # are left out. Quoting is off: a quotation mark is
/// an ordinary character, so that a stray one does not join lines.
pub struct TableRows<'p, R> {
    path: &'p Path,
    most_line_bytes: usize,
    reader: csv::Reader<Chain<ShortLines<R>, &'static [u8]>>,
    record: ByteRecord,
}

/// A row that is not empty.
pub struct TableRow {
    /// Number of its line in the text, counted from 1.
    pub line: usize,
    record: StringRecord,
}

impl<'p, R: Read> TableRows<'p, R> {
    /// Makes a reader of the rows of `text`. Messages call the text `path`. Lines of `most_line_bytes` or more are refused.
    pub fn new(path: &'p Path, text: R, most_line_bytes: usize) -> Self {
        let mut builder = csv::ReaderBuilder::new();
        builder.has_headers(false).flexible(true).quoting(false).terminator(Terminator::Any(b'\n'));
        // The reader counts line ends. With this addition the last line has an end, too.
        let text = ShortLines { text, line_bytes: 0, most: most_line_bytes }.chain(&b"\n"[..]);
        Self { path, most_line_bytes, reader: builder.from_reader(text), record: ByteRecord::new() }
    }

    /// Returns the next row; `None` behind the last. Bytes that are not UTF-8 are replaced.
    ///
    /// # Errors
    /// [`Error::Io`] if the text cannot be read, [`Error::Broken`] for a line too long.
    pub fn next_row(&mut self) -> Result<Option<TableRow>> {
        while self.reader.read_byte_record(&mut self.record).map_err(|error| self.refusal(error))? {
            let line = self.reader.position().line() as usize - 1;
            let row = TableRow { line, record: StringRecord::from_byte_record_lossy(self.record.clone()) };
            if !row.is_blank() {
                return Ok(Some(row));
            }
        }
        Ok(None)
    }

    fn refusal(&self, error: csv::Error) -> Error {
        if self.reader.get_ref().get_ref().0.is_over() {
            let (line, most) = (self.reader.position().line(), self.most_line_bytes);
            return Error::broken(self.path, format!("line {line}: a line below {most} bytes expected"));
        }
        match error.into_kind() {
            csv::ErrorKind::Io(error) => Error::io(self.path)(error),
            other => Error::broken(self.path, format!("{other:?}")),
        }
    }
}

impl TableRow {
    /// Returns the cells without surrounding blanks.
    #[must_use]
    pub fn cells(&self) -> Vec<&str> {
        // Texts that were joined may have byte order marks inside.
        let first = self.record.iter().take(1).map(|cell| cell.trim_start_matches('\u{feff}'));
        first.chain(self.record.iter().skip(1)).map(str::trim).collect()
    }

    /// Returns the whole line without surrounding blanks.
    #[must_use]
    pub fn text(&self) -> String {
        let line = self.record.iter().collect::<Vec<_>>().join(",");
        line.trim_start_matches('\u{feff}').trim().into()
    }

    fn is_blank(&self) -> bool {
        let cells = self.cells();
        cells == [""] || cells.first().is_none_or(|first| first.starts_with('#'))
    }
}

/// Passes a text on until a line has `most` bytes, its end included. This bounds the memory for a row.
struct ShortLines<R> {
    text: R,
    line_bytes: usize,
    most: usize,
}

impl<R> ShortLines<R> {
    fn is_over(&self) -> bool {
        self.line_bytes >= self.most
    }
}

impl<R: Read> Read for ShortLines<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let too_long = || std::io::Error::from(std::io::ErrorKind::InvalidData);
        if self.is_over() {
            return Err(too_long());
        }
        let read = self.text.read(out)?;
        for (at, &byte) in out[..read].iter().enumerate() {
            self.line_bytes += 1;
            if self.is_over() {
                // Passing on nothing would mean the end of the text.
                return if at == 0 { Err(too_long()) } else { Ok(at) };
            }
            if byte == b'\n' {
                self.line_bytes = 0;
            }
        }
        Ok(read)
    }
}

/// Returns a table as CSV. Cells are quoted where necessary; lines end with a line feed alone.
///
/// # Errors
/// [`Error::Usage`] if rows differ in length.
pub fn to_csv<C: AsRef<[u8]>>(rows: impl IntoIterator<Item = impl IntoIterator<Item = C>>) -> Result<Vec<u8>> {
    let refuse = |what: String| Error::usage(format!("table: {what}"));
    let mut writer = csv::Writer::from_writer(vec![]);
    for row in rows {
        writer.write_record(row).map_err(|e| refuse(e.to_string()))?;
    }
    writer.into_inner().map_err(|e| refuse(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str, most: usize) -> Result<Vec<(usize, Vec<String>)>> {
        let mut rows = TableRows::new(Path::new("t.csv"), text.as_bytes(), most);
        let mut found = vec![];
        while let Some(row) = rows.next_row()? {
            found.push((row.line, row.cells().into_iter().map(String::from).collect()));
        }
        Ok(found)
    }

    #[test]
    fn rows_have_the_numbers_of_their_lines() {
        let text = "\u{feff}# head\r\n\r\na, b ,c\n \t\n  # no, row\n\u{feff} d\r\ne \"x,y\"";
        let expected = [(3, vec!["a", "b", "c"]), (6, vec!["d"]), (7, vec!["e \"x", "y\""])]
            .map(|(line, cells)| (line, cells.into_iter().map(String::from).collect::<Vec<_>>()));
        assert_eq!(rows(text, 100).unwrap(), expected);
        assert!(rows("", 100).unwrap().is_empty() && rows("\n\n#", 100).unwrap().is_empty());
    }

    #[test]
    fn lines_have_a_length() {
        for long in [1_usize, 50, 8191, 8192, 8193, 20_000] {
            let line = "1".repeat(long);
            for end in ["", "\n", "\n2"] {
                let text = format!("a\n{line}{end}");
                let bytes = long + usize::from(!end.is_empty());
                assert!(rows(&text, bytes.max(2) + 1).is_ok(), "{long}");
                let refused = (bytes > 2).then(|| rows(&text, bytes).unwrap_err().to_string());
                let expected = format!("t.csv: broken file: line 2: a line below {bytes} bytes expected");
                assert!(refused.is_none_or(|found| found == expected), "{long}");
            }
        }
    }

    #[test]
    fn csv_is_quoted_where_it_must_be() {
        let csv = to_csv([["a,b", "|e|, %"], ["", "say \"x\""]]).unwrap();
        assert_eq!(String::from_utf8(csv).unwrap(), "\"a,b\",\"|e|, %\"\n,\"say \"\"x\"\"\"\n");
        assert!(to_csv([vec!["a", "b"], vec!["c"]]).is_err());
    }
}
