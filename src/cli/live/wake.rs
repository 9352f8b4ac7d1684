//! Notices what happens elsewhere: files that change, and Ctrl-C.
//!
//! Files are looked at twenty times a second. Compared with notifications of the system this is the same on every system and file system
//! (those of other machines and containers too), and does not mind how an editor saves: in place, or by renaming a new file to the old
//! one's name, after which a notification would still be about the old file. A script has few files, and looking at one takes a microsecond.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use super::hub::{Hub, Order};
use crate::diag::Diagnostic;
use crate::files::{Stamp, stamp};
use crate::session::world;

const PAUSE: Duration = Duration::from_millis(25);

/// Looks after which a file that has gone is taken as deleted, not as being replaced.
const REPLACED_BY: u32 = 8;

/// Starts the thread that looks.
pub fn start(hub: &Arc<Hub>) -> Result<(), Diagnostic> {
    let hub = hub.clone();
    let watch = move || {
        let mut seen = Seen::default();
        loop {
            std::thread::sleep(PAUSE);
            if hub.is_closed() {
                return;
            }
            if world::interrupted() {
                hub.wake();
            }
            let [own, read] = seen.changes(&hub.files());
            for (changed, read) in [(own, false), (read, true)] {
                if changed {
                    hub.ask(Order::Changed { read });
                }
            }
        }
    };
    match std::thread::Builder::new().name("files".into()).spawn(watch) {
        Ok(_) => Ok(()),
        Err(e) => Err(Diagnostic::error("dscene::live::thread", format!("cannot start a thread for files: {e}"))),
    }
}

/// A file that is looked at.
#[derive(Clone, Debug)]
pub struct Watched {
    pub path: PathBuf,
    /// The script reads it, and is not made of it.
    pub is_read: bool,
    /// As it was before it was read: what has changed since is a change.
    pub known: Stamp,
}

/// The files as they were when they were last looked at.
#[derive(Default)]
struct Seen(HashMap<PathBuf, File>);

struct File {
    /// As it was when a change was last told.
    told: Stamp,
    /// As it was at the last look, and for how many looks it has been so.
    last: Stamp,
    looks: u32,
}

impl Seen {
    /// Whether files of the script, and whether files that it reads, have changed: told once they have stayed the same for a look, since an
    /// editor may still be writing.
    fn changes(&mut self, files: &[Watched]) -> [bool; 2] {
        self.0.retain(|path, _| files.iter().any(|file| file.path == *path));
        let mut found = [false, false];
        for Watched { path, is_read, known } in files {
            let now = stamp(path);
            let file = self.0.entry(path.clone()).or_insert(File { told: *known, last: *known, looks: 0 });
            file.looks = if now == file.last { file.looks + 1 } else { 0 };
            file.last = now;
            let patience = if now.is_none() { REPLACED_BY } else { 1 };
            if now != file.told && file.looks >= patience {
                file.told = now;
                found[usize::from(*is_read)] = true;
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_told_once_they_are_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let write = |name: &str, text: &str| std::fs::write(path(name), text).unwrap();
        write("script", "a");
        write("mesh", "a");
        let files = [("script", false), ("mesh", true), ("none", true)];
        let files = files.map(|(name, is_read)| Watched { path: path(name), is_read, known: stamp(&path(name)) });
        // Between being read and the first look.
        write("mesh", "ab");
        let mut seen = Seen::default();
        let mut look = |n: u32| (0..n).map(|_| seen.changes(&files)).collect::<Vec<[bool; 2]>>();
        assert_eq!(look(3), [[false, false], [false, true], [false, false]]);
        write("script", "ab");
        assert_eq!(look(1), [[false, false]]);
        write("script", "abc");
        assert_eq!(look(3), [[false, false], [true, false], [false, false]]);
        // Renamed to, as many editors save.
        write("new", "abc");
        std::fs::rename(path("new"), path("mesh")).unwrap();
        assert_eq!(look(2), [[false, false], [false, true]]);
        // Gone for a moment, then for good, then back.
        std::fs::remove_file(path("script")).unwrap();
        assert_eq!(look(3), [[false, false]; 3]);
        write("script", "abcd");
        assert_eq!(look(2), [[false, false], [true, false]]);
        std::fs::remove_file(path("script")).unwrap();
        assert_eq!(look(REPLACED_BY + 2).iter().filter(|found| found[0]).count(), 1);
        write("script", "abcd");
        write("none", "");
        assert_eq!(look(2), [[false, false], [true, true]]);
    }
}
