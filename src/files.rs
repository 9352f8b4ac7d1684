//! Files of the outside world: read whole, if they are ordinary and of bearable size; written whole or not at all.

use std::fs;
use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::memory;

/// The largest file that is read.
pub const MAX_FILE_BYTES: u64 = 1 << 31;

/// The bytes of an ordinary file of bearable size, or why not, in words. Pipes, devices and folders are refused before they are
/// opened: some never end, and some never begin.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    read(path).map_err(|e| describe_io(&e))
}

/// The same with the kind of the error; [`describe_io`] has its words.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    ordinary(&fs::metadata(path)?)?;
    let file = fs::File::open(path)?;
    // Once more: between the two the path may have come to mean another file.
    let metadata = file.metadata()?;
    ordinary(&metadata)?;
    memory::ask(metadata.len()).map_err(io::Error::other)?;
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes)?;
    // Files that the system makes up (those of /proc) and files that grow have more than they say.
    if bytes.len() as u64 > MAX_FILE_BYTES { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
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

/// Writes beside the file and renames: at every moment the path holds the old file or the new one, whole.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let name = path.file_name().ok_or_else(|| io::Error::other("the path names no file"))?;
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    let temporary = path.with_file_name(format!(".{}.{}-{number}.tmp", name.to_string_lossy(), std::process::id()));
    let written = fs::File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    let renamed = written.and_then(|()| fs::rename(&temporary, path));
    if renamed.is_err() {
        // What went wrong first matters more than whether the leftover can be removed.
        let _ = fs::remove_file(&temporary);
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
        ErrorKind::IsADirectory => "this is a folder, not a file".to_string(),
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
}
