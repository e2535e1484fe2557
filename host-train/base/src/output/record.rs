//! The record of an owner: which process on which machine, since when.

use std::time::{SystemTime, UNIX_EPOCH};

/// First line of a record.
const HEAD: &str = "elunar owner 2";
/// That of programs that do not renew their locks.
const HEAD_UNRENEWED: &str = "elunar owner 1";

/// A process that owns an output. Fields that this system does not tell are empty.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OutputRecord {
    /// Name of the machine.
    pub(super) host: String,
    /// Number that the running kernel took when it started.
    pub(super) boot: String,
    /// The name space of process numbers: containers have their own.
    pub(super) namespace: String,
    pub(super) pid: u32,
    /// Start of the process, in the kernel's count. A later process of the same number has another.
    pub(super) process_start: Option<u64>,
    /// Seconds of the Unix epoch when the output was taken.
    pub(super) since_s: u64,
    /// Whether the owner touches its lock as long as it lives.
    pub(super) is_renewed: bool,
}

impl OutputRecord {
    /// Returns the record of this process.
    pub(super) fn here() -> Self {
        #[cfg(all(test, unix))]
        if let Some(simulated) = super::simulated::here() {
            return simulated;
        }
        let read = |path: &str| std::fs::read_to_string(path).ok().map(|text| text.trim().to_string());
        let namespace = std::fs::read_link("/proc/self/ns/pid");
        // WebAssembly has no processes.
        let pid = if cfg!(target_family = "wasm") { 0 } else { std::process::id() };
        Self {
            host: host_name(),
            boot: read("/proc/sys/kernel/random/boot_id").unwrap_or_default(),
            namespace: namespace.map_or_else(|_| String::new(), |name| name.to_string_lossy().into_owned()),
            pid,
            process_start: start_of(pid),
            since_s: now_s(),
            is_renewed: true,
        }
    }

    /// Returns the record as lines of a name and a value.
    pub(super) fn text(&self) -> String {
        let Self { host, boot, namespace, pid, process_start, since_s, is_renewed } = self;
        let head = if *is_renewed { HEAD } else { HEAD_UNRENEWED };
        let start = process_start.map_or_else(String::new, |start| start.to_string());
        format!(
            "{head}\nhost {host}\nboot {boot}\nnamespace {namespace}\npid {pid}\nprocess-start {start}\nsince {since_s}\n"
        )
    }

    /// Reads a record; `None` if the text is none.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let is_renewed = text.starts_with(HEAD);
        let head = if is_renewed { HEAD } else { HEAD_UNRENEWED };
        let mut lines = text.strip_prefix(head)?.strip_prefix('\n')?.lines();
        let mut value = |name: &str| lines.next()?.strip_prefix(name)?.strip_prefix(' ').map(str::to_string);
        Some(Self {
            host: value("host")?,
            boot: value("boot")?,
            namespace: value("namespace")?,
            pid: value("pid")?.parse().ok()?,
            process_start: Some(value("process-start")?)
                .filter(|start| !start.is_empty())
                .map(|s| s.parse())
                .transpose()
                .ok()?,
            since_s: value("since")?.parse().ok()?,
            is_renewed,
        })
    }

    /// Returns whether the process has surely ended, as seen by `here`, which already holds the kernel's lock on the record's file.
    /// `start_of` returns the start of a running process.
    pub(super) fn has_ended(&self, here: &Self, start_of: impl Fn(u32) -> Option<u64>) -> bool {
        if self.boot.is_empty() || self.boot != here.boot {
            // The same machine has started anew, or tells no boots apart. Of another machine nothing is known, and the machines of a cluster may
            // share a name: who renews its lock is judged by that alone.
            return self.host == here.host && (!self.is_renewed || self.boot.is_empty());
        }
        // Under one kernel its lock is enough. Where file systems only pretend to lock, the process numbers still tell.
        self.namespace != here.namespace || self.process_start.is_none() || start_of(self.pid) != self.process_start
    }

    /// Returns whether the process ran under another kernel, so that nothing is known of it but what its lock shows.
    pub(super) fn is_elsewhere(&self, here: &Self) -> bool {
        self.boot.is_empty() || self.boot != here.boot
    }

    /// Returns the process for messages.
    pub(super) fn who(&self) -> String {
        let (host, age_s) = (&self.host, now_s().saturating_sub(self.since_s));
        let at = if host.is_empty() { String::new() } else { format!(" on {host}") };
        format!("process {}{at}, for {age_s} s", self.pid)
    }
}

/// Returns the name of this machine; empty if the system does not tell.
#[must_use]
pub fn host_name() -> String {
    let read = |path: &str| std::fs::read_to_string(path).ok().map(|text| text.trim().to_string());
    let named = |name: &str| std::env::var(name).ok();
    let host = read("/proc/sys/kernel/hostname").or_else(|| read("/etc/hostname"));
    host.or_else(|| named("HOSTNAME")).or_else(|| named("COMPUTERNAME")).unwrap_or_default()
}

/// Returns the start of a running process, in ticks since the kernel's start; `None` if it does not run, or this system does not tell.
pub(super) fn start_of(pid: u32) -> Option<u64> {
    #[cfg(all(test, unix))]
    if super::simulated::is_active() {
        return super::simulated::start_of(pid);
    }
    const ENDED: [&str; 2] = ["Z", "X"];
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name of the program, in brackets, may hold spaces and brackets.
    let mut fields = text.rsplit_once(") ")?.1.split(' ');
    let state = fields.next()?;
    fields.nth(18).filter(|_| !ENDED.contains(&state))?.parse().ok()
}

fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> OutputRecord {
        let [host, boot, namespace] = ["moon", "b-1", "pid:[4]"].map(String::from);
        OutputRecord { host, boot, namespace, pid: 7, process_start: Some(99), since_s: 5, is_renewed: true }
    }

    #[test]
    fn a_record_reads_back() {
        for known in [
            record(),
            OutputRecord { is_renewed: false, ..record() },
            OutputRecord { process_start: None, boot: String::new(), ..record() },
            OutputRecord::here(),
        ] {
            assert_eq!(OutputRecord::parse(&known.text()), Some(known));
        }
        let text = record().text();
        for other in
            ["", "elunar owner 3\n", &text[..text.len() - 3], &text.replace("pid", "PID"), &text.replace('7', "x")]
        {
            assert_eq!(OutputRecord::parse(other), None, "{other}");
        }
    }

    #[test]
    fn an_owner_has_ended_only_if_that_is_sure() {
        let here = record();
        let ended = |record: OutputRecord, start| record.has_ended(&here, |pid| if pid == 7 { start } else { None });
        assert!(!ended(record(), Some(99)), "it runs");
        assert!(ended(record(), None) && ended(record(), Some(100)), "it runs no longer, or its number is another's");
        let contained = OutputRecord { namespace: "pid:[5]".into(), ..record() };
        assert!(ended(contained, Some(99)), "numbers of another name space say nothing, the kernel's lock does");
        let rebooted = OutputRecord { boot: "b-2".into(), ..record() };
        assert!(!ended(rebooted.clone(), Some(99)), "another machine may have the name");
        let rebooted = OutputRecord { is_renewed: false, ..rebooted };
        assert!(ended(rebooted.clone(), Some(99)));
        assert!(!ended(OutputRecord { host: "mars".into(), ..rebooted }, None), "another machine");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_process_runs_and_a_reaped_one_does_not() {
        assert!(start_of(std::process::id()).is_some_and(|start| start > 0));
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        assert_eq!(start_of(child.id()), None);
    }
}
