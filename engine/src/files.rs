//! Files of the outside world: read whole, if they are ordinary and of bearable size; written whole or not at all.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read, Seek, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::memory;
use crate::ranks;

/// The largest file that is read.
pub const MAX_FILE_BYTES: u64 = 1 << 31;

/// The bytes of an ordinary file of bearable size, or why not, in words. Pipes, devices and folders are refused before they are
/// opened: some never end, and some never begin.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    read(path).map_err(|e| describe_io(&e))
}

/// Whether there is something at a path.
pub fn exists(path: &Path) -> bool {
    asked(path, |path| path.exists())
}

/// Whether there is a file at a path.
pub fn is_file(path: &Path) -> bool {
    asked(path, |path| path.is_file())
}

/// A question about an input: asked by whoever reads it, so that all ranks have the same answer.
fn asked(path: &Path, question: impl Fn(&Path) -> bool) -> bool {
    let answer = |path: &Path| if question(path) { Ok(Vec::new()) } else { Err(io::ErrorKind::NotFound.into()) };
    ranks::read_input(path, answer).is_ok()
}

/// At most so many bytes from the end of a file, and whether these are all.
pub fn read_end(path: &Path, most: u64) -> io::Result<(Vec<u8>, bool)> {
    let metadata = fs::metadata(path)?;
    ordinary(&metadata)?;
    let mut file = fs::File::open(path)?;
    let start = metadata.len().saturating_sub(most);
    file.seek(io::SeekFrom::Start(start))?;
    let mut bytes = Vec::new();
    file.take(most).read_to_end(&mut bytes)?;
    Ok((bytes, start == 0))
}

/// By which a file is the same as before; `None` if there is none.
pub type Stamp = Option<(u64, Option<std::time::SystemTime>, u64)>;

/// That of a file as it is now.
pub fn stamp(path: &Path) -> Stamp {
    let metadata = fs::metadata(path).ok()?;
    #[cfg(unix)]
    let number = std::os::unix::fs::MetadataExt::ino(&metadata);
    #[cfg(not(unix))]
    let number = 0;
    Some((metadata.len(), metadata.modified().ok(), number))
}

/// The same with the kind of the error; [`describe_io`] has its words.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let bytes = ranks::read_input(path, read_here)?;
    note(path, Some(fingerprint(&bytes)));
    Ok(bytes)
}

fn read_here(path: &Path) -> io::Result<Vec<u8>> {
    ordinary(&fs::metadata(path)?)?;
    let file = fs::File::open(path)?;
    // Once more: between the two the path may have come to mean another file.
    let metadata = file.metadata()?;
    ordinary(&metadata)?;
    note_input(path);
    memory::ask(metadata.len()).map_err(io::Error::other)?;
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
    // Files that the system makes up (those of /proc) and files that grow have more than they say.
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// The bytes of a file that dscene itself has written, however many: it is no input of a script.
pub fn read_own(path: &Path) -> io::Result<Vec<u8>> {
    let metadata = fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, not_a_file(&metadata)));
    }
    memory::ask(metadata.len()).map_err(io::Error::other)?;
    fs::read(path)
}

/// A hash of a file's bytes, by which a later run sees whether it still is the same file. It guards against oversight, not against
/// those who want two files to have the same.
pub fn fingerprint(bytes: &[u8]) -> u64 {
    let mix = |hash: u64, word: u64| ((hash ^ word).wrapping_mul(0x9E37_79B9_7F4A_7C15)).rotate_left(29);
    let words = bytes.chunks_exact(8);
    let rest = words.remainder();
    let hash =
        words.fold(bytes.len() as u64, |hash, w| mix(hash, u64::from_le_bytes(w.try_into().unwrap_or_default())));
    let hash = rest.iter().fold(hash, |hash, byte| mix(hash, u64::from(*byte)));
    let hash = (hash ^ (hash >> 32)).wrapping_mul(0xD6E8_FEB8_6659_FD93);
    hash ^ (hash >> 32)
}

/// Whether there is an ordinary file of at most so many bytes.
pub fn is_ordinary_up_to(path: &Path, most: u64) -> bool {
    asked(path, |path| fs::metadata(path).is_ok_and(|metadata| metadata.is_file() && metadata.len() <= most))
}

fn ordinary(metadata: &fs::Metadata) -> io::Result<()> {
    if metadata.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "this is a folder, not a file"));
    }
    if !metadata.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, not_a_file(metadata)));
    }
    if metadata.len() > MAX_FILE_BYTES { Err(too_large(metadata.len())) } else { Ok(()) }
}

#[cfg(unix)]
fn not_a_file(metadata: &fs::Metadata) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    let kind = metadata.file_type();
    match () {
        () if kind.is_fifo() => "this is a pipe; only ordinary files are read",
        () if kind.is_char_device() || kind.is_block_device() => "this is a device; only ordinary files are read",
        () if kind.is_socket() => "this is a socket; only ordinary files are read",
        () => "this is not an ordinary file",
    }
}

#[cfg(not(unix))]
fn not_a_file(_: &fs::Metadata) -> &'static str {
    "this is not an ordinary file"
}

fn too_large(bytes: u64) -> io::Error {
    let (size, limit) = (memory::size_text(bytes), memory::size_text(MAX_FILE_BYTES));
    io::Error::new(io::ErrorKind::FileTooLarge, format!("the file has {size}, more than the limit of {limit}"))
}

/// The files that this process has read, with their fingerprints, or is about to read.
static INPUTS: Mutex<BTreeMap<PathBuf, Option<u64>>> = Mutex::new(BTreeMap::new());

/// Remembers a file that is read, or named to be read later: [`is_input`] says so from now on.
pub fn note_input(path: &Path) {
    note(path, None);
}

fn note(path: &Path, found: Option<u64>) {
    if let Ok(path) = path.canonicalize() {
        let mut inputs = INPUTS.lock().unwrap_or_else(PoisonError::into_inner);
        let known = inputs.entry(path).or_default();
        *known = found.or(*known);
    }
}

/// The files that were read so far, by their full paths, with their fingerprints.
pub fn inputs() -> Vec<(PathBuf, u64)> {
    let inputs = INPUTS.lock().unwrap_or_else(PoisonError::into_inner);
    inputs.iter().filter_map(|(path, found)| Some((path.clone(), (*found)?))).collect()
}

/// Whether something written to this path would replace a file that was read: by the same or another spelling, or through a link.
pub fn is_input(path: &Path) -> bool {
    // What is not there was not read.
    let Ok(target) = path.canonicalize() else { return false };
    let inputs = INPUTS.lock().unwrap_or_else(PoisonError::into_inner);
    inputs.contains_key(&target) || inputs.keys().any(|input| is_same_file(input, &target))
}

/// Whether two paths are hard links to one file.
#[cfg(unix)]
fn is_same_file(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |path: &Path| fs::metadata(path).ok().map(|m| (m.dev(), m.ino()));
    identity(a).is_some() && identity(a) == identity(b)
}

#[cfg(not(unix))]
fn is_same_file(a: &Path, b: &Path) -> bool {
    a == b
}

/// Why no output may have this name, in words and with what to do about it; `None` if it may. An output is named by a relative
/// path that stays inside of its folder, and is none of the files that runs write about themselves, nor in a folder of such a name.
pub fn refused_output(name: &str) -> Option<(&'static str, &'static str)> {
    let path = Path::new(name);
    let is_inside = path.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if !is_inside || path.file_name().is_none() {
        return Some((
            "outputs are written into the run folder",
            "give a relative path without `..`, such as \"pictures/final.exr\"",
        ));
    }
    let first = path.components().find(|c| matches!(c, Component::Normal(_)));
    let is_own = first.is_some_and(|name| is_run_file(&name.as_os_str().to_string_lossy()));
    is_own.then_some(("this is the name of a file in which the run itself is recorded", "give the output another name"))
}

/// Names, at the top of a run folder, of what dscene writes there on its own account. Some file systems know neither upper and
/// lower case nor dots and blanks at the end of a name, so none of them makes another name here.
pub fn is_run_file(name: &str) -> bool {
    let name = name.to_uppercase().to_lowercase();
    let name = name.trim_end_matches(['.', ' ']);
    let is_or_precedes =
        |own: &str| name.strip_prefix(own).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    ["run.json", "log.jsonl", "report.jsonl", "report.html", "checkpoint", "events.out.tfevents", RUN_LOCK]
        .into_iter()
        .any(is_or_precedes)
}

/// The file in a run folder that its writer keeps locked.
pub const RUN_LOCK: &str = ".lock";

/// Writes beside the file and renames: at every moment the path holds the old file or the new one, whole. A link at the path is
/// replaced, not followed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().ok_or_else(|| io::Error::other("the path names no file"))?;
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    let temporary = path.with_file_name(format!(".{}.{}-{number}.tmp", name.to_string_lossy(), std::process::id()));
    write_through(&temporary, path, bytes)
}

/// Whether a name is that of a file which [`write_atomically`] had begun when its process was killed: `.NAME.PROCESS-NUMBER.tmp`.
pub fn is_leftover(name: &str) -> bool {
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let numbers =
        name.strip_prefix('.').and_then(|rest| rest.strip_suffix(".tmp")).and_then(|rest| rest.rsplit_once('.'));
    numbers.and_then(|(_, numbers)| numbers.split_once('-')).is_some_and(|(a, b)| digits(a) && digits(b))
}

/// [`write_atomically`] for a file that only this process writes, and writes again and again: `FILE.part` is all that a process which
/// is killed leaves behind, and the next one replaces it.
pub fn rewrite(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let name = path.file_name().ok_or_else(|| io::Error::other("the path names no file"))?;
    let part = path.with_file_name(format!("{}.part", name.to_string_lossy()));
    if !ranks::is_first() {
        return Ok(());
    }
    match fs::remove_file(&part) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
        _ => write_through(&part, path, bytes),
    }
}

/// [`write_atomically`] in place of a file that a person keeps: its permissions stay, what is only to be read is not written, and neither
/// is what a link leads to, which may belong to something else.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let metadata = fs::symlink_metadata(path)?;
    if metadata.is_symlink() {
        return Err(io::Error::other("this is a link; name the file that it leads to"));
    }
    if metadata.permissions().readonly() {
        return Err(io::ErrorKind::PermissionDenied.into());
    }
    write_atomically(path, bytes)?;
    fs::set_permissions(path, metadata.permissions())
}

/// Of several ranks only the first one writes.
fn write_through(temporary: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    if !ranks::is_first() {
        return Ok(());
    }
    // Made anew: what already has the name, a link for instance, is not written through.
    let mut file = fs::File::create_new(temporary)?;
    let written = file.write_all(bytes).and_then(|()| file.sync_all());
    drop(file);
    let renamed = written.and_then(|()| fs::rename(temporary, path));
    if renamed.is_err() {
        // What went wrong first matters more than whether the leftover can be removed.
        let _ = fs::remove_file(temporary);
    }
    renamed
}

/// An input-output error in plain words.
pub fn describe_io(error: &io::Error) -> String {
    use io::ErrorKind;
    match error.kind() {
        ErrorKind::NotFound => "there is no such file or folder".to_string(),
        ErrorKind::PermissionDenied => "permission denied".to_string(),
        ErrorKind::StorageFull => "the disk is full".to_string(),
        ErrorKind::QuotaExceeded => "your share of the disk is used up".to_string(),
        ErrorKind::ReadOnlyFilesystem => "the disk can only be read".to_string(),
        ErrorKind::IsADirectory => "this is a folder, not a file".to_string(),
        ErrorKind::NotADirectory => "a part of the path is a file, not a folder".to_string(),
        ErrorKind::InvalidFilename => {
            "the name is too long, or has characters that no file's name may have".to_string()
        }
        _ => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_ordinary_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        fs::write(&file, "abc").unwrap();
        assert_eq!(read_bytes(&file), Ok(b"abc".to_vec()));
        assert_eq!(read_bytes(folder.path()).unwrap_err(), "this is a folder, not a file");
        assert_eq!(read_bytes(&folder.path().join("b")).unwrap_err(), "there is no such file or folder");
        let large = fs::File::create(&file).unwrap();
        large.set_len(MAX_FILE_BYTES + 1).unwrap();
        assert_eq!(read_bytes(&file).unwrap_err(), "the file has 2.1 GB, more than the limit of 2.1 GB");
        if cfg!(unix) {
            assert_eq!(
                read_bytes(Path::new("/dev/zero")).unwrap_err(),
                "this is a device; only ordinary files are read"
            );
        }
    }
    #[test]
    fn what_was_read_is_an_input_by_every_name() {
        let folder = tempfile::tempdir().unwrap();
        let (file, other) = (folder.path().join("a"), folder.path().join("b"));
        fs::write(&file, "abc").unwrap();
        fs::write(&other, "abc").unwrap();
        fs::create_dir(folder.path().join("deep")).unwrap();
        fs::hard_link(&file, folder.path().join("hard")).unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(&file, folder.path().join("soft")).unwrap();
        assert!(!is_input(&file));
        read(&file).unwrap();
        assert!(is_input(&file) && is_input(&folder.path().join("deep/../a")));
        assert!(!cfg!(unix) || is_input(&folder.path().join("hard")) && is_input(&folder.path().join("soft")));
        assert!(!is_input(&other) && !is_input(&folder.path().join("none")));
    }

    #[test]
    fn outputs_stay_inside_and_spare_the_record() {
        for name in
            ["x.png", "./x.png", "frames/0001.png", "frames/run.json", "running.json", "checkpoints/x.json", "locked"]
        {
            assert_eq!(refused_output(name), None, "{name:?}");
        }
        assert!(is_leftover(".x.png.123-0.tmp") && is_leftover(".run.json.7-12.tmp"));
        assert!(
            !["x.png.123-0.tmp", ".x.png.tmp", ".x.1-.tmp", ".x.a-0.tmp", ".tmp", ".1-0.tmp"]
                .iter()
                .any(|n| is_leftover(n))
        );
        for name in ["", "..", "../x.png", "/etc/x.png", "a/../../x.png", "a/../run.json", "."] {
            assert_eq!(refused_output(name).unwrap().0, "outputs are written into the run folder", "{name:?}");
        }
        let own = ["run.json", "./run.json", ".//Run.JSON", "LOG.jsonl", "checkpoint.json", "chec\u{212a}point.npy"];
        let own = own.into_iter().chain([
            "events.out.tfevents",
            "run.json.part",
            "run.json. ",
            "run.j\u{17f}on",
            ".lock",
            "report.html",
            "report.html/x.json",
            "./Checkpoint.bin/deep/x.json",
        ]);
        for name in own {
            assert!(refused_output(name).is_some_and(|(what, _)| what.contains("run itself")), "{name:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_replaced_and_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("a"), folder.path().join("link"));
        fs::write(&file, "abc").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_atomically(&link, b"new").unwrap();
        assert_eq!((fs::read(&file).unwrap(), fs::read(&link).unwrap()), (b"abc".to_vec(), b"new".to_vec()));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }
}
