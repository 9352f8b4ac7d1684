//! Processes that do one run together: ranks, as MPI calls them, each on processors or on a machine of its own.
//!
//! Every rank evaluates the same script with the same seed, and so comes to the same numbers. What takes long, the samples of images and
//! of derivatives, is cut into parts that do not depend on how many ranks there are. Each rank draws the samples of its share, the ranks
//! give each other what they have found ([`map`], [`share`], [`exchange`]), and each adds it up in the order of the parts. So all have the
//! same bytes, which are those of one process. The first rank alone writes files and speaks to people ([`is_first`]).
//!
//! How messages travel is not known here: a [`Link`] carries them (the crate in `mpi/` has one). A thread without a link is the only rank.

use std::cell::{Cell, RefCell};
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Instant;

use bytemuck::Pod;
use rayon::prelude::*;

use crate::stop;

/// Carries messages between ranks. All ranks make the same calls in the same order.
pub trait Link: Send + Sync {
    /// The number of this rank, from 0.
    fn rank(&self) -> usize;

    /// The number of ranks.
    fn count(&self) -> usize;

    /// The number of ranks on this machine.
    fn neighbours(&self) -> usize;

    /// Gives each rank the message of that number, and returns the messages of all ranks to this one, by rank.
    ///
    /// # Errors
    /// [`Lost`] if a rank has ended or this process is to stop. After that the link carries nothing any more.
    fn exchange(&self, messages: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost>;

    /// Gives all ranks this rank's message, and returns those of all, by rank.
    ///
    /// # Errors
    /// As [`Link::exchange`].
    fn share(&self, message: Vec<u8>) -> Result<Vec<Vec<u8>>, Lost>;

    /// Ends this rank's part. Returns whether all ranks have come to their ends.
    fn end(&self) -> bool;
}

/// Other ranks do not answer any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost;

thread_local! {
    static LINK: RefCell<Option<Arc<dyn Link>>> = const { RefCell::new(None) };
}

/// Whether this process is one of several ranks, and whether it is another than the first one.
static IS_RANK: AtomicBool = AtomicBool::new(false);
static IS_MUTE: AtomicBool = AtomicBool::new(false);

/// The link by which the first rank gives all others the files that it reads, if they are not to read them themselves.
static FILES: OnceLock<Arc<dyn Link>> = OnceLock::new();

/// Whether this process has found that others do something else.
static CAME_APART: AtomicBool = AtomicBool::new(false);

/// What another rank than the first would have told people.
static UNTOLD: Mutex<String> = Mutex::new(String::new());

/// What messages between ranks have cost this thread.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Traffic {
    /// How often ranks have given each other messages.
    pub exchanges: u64,
    /// Bytes of the messages to this rank from others.
    pub received: u64,
    /// Time until all messages were there, which includes that in which others were still at work.
    pub seconds: f64,
}

thread_local! {
    static TRAFFIC: Cell<Traffic> = const { Cell::new(Traffic { exchanges: 0, received: 0, seconds: 0.0 }) };
}

/// What this thread's messages have cost so far.
pub fn traffic() -> Traffic {
    TRAFFIC.get()
}

/// Does work as one of several ranks, on this thread.
pub fn within<T>(link: Arc<dyn Link>, work: impl FnOnce() -> T) -> T {
    /// Restores the link of the surrounding work, also when unwinding.
    struct Outer(Option<Arc<dyn Link>>);
    impl Drop for Outer {
        fn drop(&mut self) {
            LINK.set(self.0.take());
        }
    }
    let _outer = Outer(LINK.replace(Some(link)));
    work()
}

/// Makes this process one of several ranks, which keeps silent and writes nothing unless it is the first one.
pub fn assign(link: &Arc<dyn Link>) {
    IS_RANK.store(true, Ordering::SeqCst);
    IS_MUTE.store(link.rank() != 0, Ordering::SeqCst);
}

/// From now on only the first rank reads files, and gives them to the others. Only the first call counts.
pub fn broadcast_files(link: &Arc<dyn Link>) {
    let _ = FILES.set(link.clone());
}

/// Whether this process is one of several ranks.
pub fn is_rank() -> bool {
    IS_RANK.load(Ordering::SeqCst)
}

/// Whether this process writes files and speaks to people.
pub fn is_first() -> bool {
    !IS_MUTE.load(Ordering::Relaxed)
}

/// Keeps what this process would have told people, in case that it alone has something to tell. Of very much it keeps the end.
pub fn keep_untold(text: &str) {
    const MOST: usize = 1 << 16;
    let mut untold = UNTOLD.lock().unwrap_or_else(PoisonError::into_inner);
    if untold.len() > MOST {
        untold.clear();
    }
    untold.push_str(text);
    untold.push('\n');
}

/// What [`keep_untold`] has kept.
pub fn untold() -> String {
    std::mem::take(&mut *UNTOLD.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Which parts of some work are this rank's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The number of this rank, from 0.
    pub rank: usize,
    /// The number of ranks, at least 1.
    pub count: usize,
}

impl Place {
    /// Whether the part of this number is this rank's. Parts are dealt in turns, so that all ranks have some of where they are expensive.
    #[inline]
    pub fn has(self, part: usize) -> bool {
        part % self.count == self.rank
    }

    /// Whether there are no other ranks.
    pub fn is_alone(self) -> bool {
        self.count == 1
    }
}

/// The place of this thread among the ranks.
pub fn place() -> Place {
    let place = |link: &Arc<dyn Link>| Place { rank: link.rank(), count: link.count() };
    LINK.with_borrow(|link| link.as_ref().map_or(Place { rank: 0, count: 1 }, place))
}

/// The number of ranks on this machine.
pub fn neighbours() -> usize {
    LINK.with_borrow(|link| link.as_ref().map_or(1, |link| link.neighbours()))
}

/// Gives each rank the message of that number, and returns those to this rank, by rank. If ranks do not answer any more, the work is ended
/// as by [`stop`], and what this thread does afterwards it does alone.
pub fn exchange(messages: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    match LINK.with_borrow(Option::clone) {
        Some(link) => answered(link.rank(), || link.exchange(messages)),
        None => messages,
    }
}

/// Gives all ranks this rank's message, and returns those of all, by rank; of lost ranks see [`exchange`].
pub fn share(message: Vec<u8>) -> Vec<Vec<u8>> {
    match LINK.with_borrow(Option::clone) {
        Some(link) => answered(link.rank(), || link.share(message)),
        None => vec![message],
    }
}

fn answered(rank: usize, ask: impl FnOnce() -> Result<Vec<Vec<u8>>, Lost>) -> Vec<Vec<u8>> {
    // Where this process is to stop, threads that help have returned early: what they have done is given to no one, who would take it for whole.
    stop::check();
    let begun = Instant::now();
    let Ok(messages) = ask() else { leave() };
    let lengths =
        messages.iter().enumerate().filter(|(from, _)| *from != rank).map(|(_, message)| message.len() as u64);
    let Traffic { exchanges, received, seconds } = TRAFFIC.get();
    let (received, seconds) = (received + lengths.sum::<u64>(), seconds + begun.elapsed().as_secs_f64());
    TRAFFIC.set(Traffic { exchanges: exchanges + 1, received, seconds });
    messages
}

/// The results of so many parts of some work, in order. The parts of each rank are computed in parallel.
pub fn map<T: Packed + Send>(parts: usize, part: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let place = place();
    if place.is_alone() {
        return (0..parts).into_par_iter().map(part).collect();
    }
    let own: Vec<T> = (place.rank..parts).into_par_iter().step_by(place.count).map(part).collect();
    let mut message = Vec::new();
    own.iter().for_each(|result| result.pack(&mut message));
    drop(own);
    let messages = share(message);
    let mut rests: Vec<&[u8]> = messages.iter().map(Vec::as_slice).collect();
    (0..parts).map(|part| T::unpack(&mut rests[part % place.count]).unwrap_or_else(|| come_apart())).collect()
}

/// Other ranks have done something else. That cannot be if they are the same program with the same script on the same kind of machine.
pub fn come_apart() -> ! {
    CAME_APART.store(true, Ordering::SeqCst);
    leave()
}

/// Ends the work, and what this thread does afterwards it does alone.
fn leave() -> ! {
    LINK.set(None);
    stop::end()
}

/// Whether this process has found that others do something else.
pub fn has_come_apart() -> bool {
    CAME_APART.load(Ordering::SeqCst)
}

/// The bytes that the first rank reads from a file, for all of them; a thread that is the only rank just reads.
///
/// # Errors
/// That of the first rank.
pub fn read_by_first(path: &Path, read: impl FnOnce(&Path) -> io::Result<Vec<u8>>) -> io::Result<Vec<u8>> {
    match LINK.with_borrow(Option::clone) {
        Some(link) => from_first(&link, path, read),
        None => read(path),
    }
}

/// The bytes of an input: read by every rank, or by the first one if it gives files to the others.
///
/// # Errors
/// That of the rank which has read it.
pub fn read_input(path: &Path, read: impl FnOnce(&Path) -> io::Result<Vec<u8>>) -> io::Result<Vec<u8>> {
    match FILES.get() {
        Some(link) => from_first(link, path, read),
        None => read(path),
    }
}

fn from_first(
    link: &Arc<dyn Link>,
    path: &Path,
    read: impl FnOnce(&Path) -> io::Result<Vec<u8>>,
) -> io::Result<Vec<u8>> {
    let found = (link.rank() == 0).then(|| read(path));
    // The bytes or the error's words, and at the end what they are.
    let message = match &found {
        Some(Ok(bytes)) => [bytes.as_slice(), b"+"].concat(),
        Some(Err(error)) if error.kind() == io::ErrorKind::NotFound => vec![b'?'],
        Some(Err(error)) => format!("{error}-").into_bytes(),
        None => Vec::new(),
    };
    let messages = link.share(message).map_err(|Lost| io::Error::other("the other processes have ended"))?;
    // The first one has its own result, with the kind of its error.
    found.unwrap_or_else(|| {
        let mut message = messages.into_iter().next().unwrap_or_default();
        match message.pop() {
            Some(b'+') => Ok(message),
            Some(b'?') => Err(io::ErrorKind::NotFound.into()),
            _ => Err(io::Error::other(String::from_utf8_lossy(&message).into_owned())),
        }
    })
}

/// What can be a message, or a part of one.
pub trait Packed: Sized {
    /// Appends its bytes.
    fn pack(&self, to: &mut Vec<u8>);

    /// Takes its bytes from the front; `None` if they are not there.
    fn unpack(from: &mut &[u8]) -> Option<Self>;
}

impl Packed for f64 {
    fn pack(&self, to: &mut Vec<u8>) {
        to.extend(self.to_ne_bytes());
    }

    fn unpack(from: &mut &[u8]) -> Option<f64> {
        let (bytes, rest) = from.split_first_chunk()?;
        *from = rest;
        Some(f64::from_ne_bytes(*bytes))
    }
}

impl<T: Pod> Packed for Vec<T> {
    fn pack(&self, to: &mut Vec<u8>) {
        to.extend((self.len() as u64).to_ne_bytes());
        to.extend(bytemuck::cast_slice::<T, u8>(self));
    }

    fn unpack(from: &mut &[u8]) -> Option<Vec<T>> {
        let (len, rest) = from.split_first_chunk()?;
        let bytes = usize::try_from(u64::from_ne_bytes(*len)).ok()?.checked_mul(size_of::<T>())?;
        let (bytes, rest) = rest.split_at_checked(bytes)?;
        *from = rest;
        Some(bytemuck::pod_collect_to_vec(bytes))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    /// One of two ranks, whose messages are counted.
    struct Counted(AtomicUsize);

    impl Link for Counted {
        fn rank(&self) -> usize {
            1
        }

        fn count(&self) -> usize {
            2
        }

        fn neighbours(&self) -> usize {
            2
        }

        fn exchange(&self, messages: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
            self.0.fetch_add(1, Ordering::Relaxed);
            Ok(messages)
        }

        fn share(&self, message: Vec<u8>) -> Result<Vec<Vec<u8>>, Lost> {
            self.0.fetch_add(1, Ordering::Relaxed);
            Ok(vec![message.clone(), message])
        }

        fn end(&self) -> bool {
            true
        }
    }

    /// A step that was ended in its midst is told to no other rank, which would take its parts for whole.
    #[test]
    fn what_is_half_done_is_given_to_no_one() {
        let link = Arc::new(Counted(AtomicUsize::new(0)));
        let flag = Arc::new(AtomicBool::new(false));
        let work = |stops: bool| {
            let part = |part: usize| {
                flag.store(stops, Ordering::Relaxed);
                part as f64
            };
            within(link.clone(), || stop::until(&flag, || map(2, &part)))
        };
        assert_eq!(work(false), Ok(vec![1.0, 1.0]));
        assert_eq!(link.0.load(Ordering::Relaxed), 1);
        assert_eq!(work(true), Err(stop::Stopped));
        assert_eq!(link.0.load(Ordering::Relaxed), 1);
    }
}
