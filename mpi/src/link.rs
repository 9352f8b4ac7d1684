//! Messages between processes by MPI.
//!
//! One thread makes all calls of MPI, so that the simplest kind of thread support is enough, and another one asks it and waits. The one that
//! waits looks at the flag of Ctrl-C meanwhile: MPI itself never gives up, not even if another process has died.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use dscene::cli::tell_lost;
use dscene::ranks::{Link, Lost};
use dscene::session::world;
use mpi::Threading;
use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives};

/// Most bytes that go to all processes at a time: MPI counts them in 31 bits.
const ROUND: usize = 1 << 29;
/// How often the flag of Ctrl-C is looked at.
const LOOK: Duration = Duration::from_millis(10);
/// How long after Ctrl-C the first process waits for answers. Open MPI kills processes a second after it has asked them to end.
const PATIENCE: Duration = Duration::from_millis(200);
/// How long the others wait. Once asked to end, `mpirun` kills all processes as soon as one of them has ended, and the first has a checkpoint
/// to write: it is to be the first that ends, if it lives.
const PATIENCE_OF_OTHERS: Duration = Duration::from_secs(5);

/// What one process says to another before its message: where it stands, and how long the message is.
type Head = [u64; 2];
const AT_WORK: u64 = 0;
const AT_END: u64 = 1;

/// What a process sends.
enum Letters {
    /// A message for each process.
    Each(Vec<Vec<u8>>),
    /// The same for all.
    Same(Vec<u8>),
    /// Nothing: it has come to its end.
    End,
}

/// What has come from all processes.
enum Answer {
    Messages(Vec<Vec<u8>>),
    /// These have ended, and sent nothing.
    Ended(Vec<usize>),
}

/// The connection to the other processes.
struct Mpi {
    rank: usize,
    count: usize,
    neighbours: usize,
    /// To the thread that makes the calls and back; `None` once it does not answer.
    post: Mutex<Option<Post>>,
    /// Whether a process has come to its end before the others: then all that is left to say is that one ends too.
    is_over: AtomicBool,
}

struct Post {
    to: SyncSender<Letters>,
    from: Receiver<Answer>,
}

/// The connection, if this process is one of several.
pub fn join() -> Option<Arc<dyn Link>> {
    let (to, letters) = sync_channel(1);
    let (answers, from) = sync_channel(1);
    let (ready, started) = sync_channel(1);
    thread::spawn(move || {
        let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else { return };
        let world = universe.world();
        let neighbours = world.split_shared(0).size();
        if ready.send((world.rank() as usize, world.size() as usize, neighbours as usize)).is_ok() {
            serve(&world, &letters, &answers);
        }
    });
    // Without MPI, or without other processes, this is `dsl` itself.
    let (rank, count, neighbours) = started.recv().ok()?;
    (count > 1).then(|| {
        let (post, is_over) = (Mutex::new(Some(Post { to, from })), AtomicBool::new(false));
        Arc::new(Mpi { rank, count, neighbours, post, is_over }) as Arc<dyn Link>
    })
}

/// Carries letters until all processes have come to their ends.
fn serve(world: &SimpleCommunicator, letters: &Receiver<Letters>, answers: &SyncSender<Answer>) {
    for letters in letters {
        let (answer, all_ended) = carry(world, &letters);
        if answers.send(answer).is_err() || all_ended {
            return;
        }
    }
}

/// The answer, and whether all processes have ended.
fn carry(world: &SimpleCommunicator, letters: &Letters) -> (Answer, bool) {
    let count = world.size() as usize;
    let message = |to: usize| match letters {
        Letters::Each(messages) => messages[to].as_slice(),
        Letters::Same(message) => message,
        Letters::End => &[],
    };
    let state = if matches!(letters, Letters::End) { AT_END } else { AT_WORK };
    let heads: Vec<Head> = (0..count).map(|to| [state, message(to).len() as u64]).collect();
    // MPI is told the types of what is sent and of what is received one by one: they must be the same.
    let mut found: Vec<Head> = vec![[0; 2]; count];
    world.all_to_all_into(heads.as_flattened(), found.as_flattened_mut());
    let ended: Vec<usize> = (0..count).filter(|rank| found[*rank][0] == AT_END).collect();
    if !ended.is_empty() {
        let all = ended.len() == count;
        return (Answer::Ended(ended), all);
    }
    // All rounds have as many bytes as the longest message between any two needs.
    let own: u64 = heads.iter().map(|[_, len]| *len).max().unwrap_or(0);
    let mut longest: u64 = 0;
    world.all_reduce_into(&own, &mut longest, SystemOperation::max());
    let round = ROUND / count;
    let mut received: Vec<Vec<u8>> = found.iter().map(|[_, len]| Vec::with_capacity(*len as usize)).collect();
    for start in (0..longest as usize).step_by(round) {
        let part = |len: usize| start.min(len)..(start + round).min(len);
        // An empty array may lie at any address, also at the one by which Open MPI is asked to send from where it receives.
        let mut sent = Vec::with_capacity(1);
        let (mut counts, mut places) = (Vec::new(), Vec::new());
        for to in 0..count {
            let message = message(to);
            // What all get is sent from one place.
            if to == 0 || !matches!(letters, Letters::Same(_)) {
                places.push(sent.len() as i32);
                sent.extend_from_slice(&message[part(message.len())]);
            } else {
                places.push(0);
            }
            counts.push(part(message.len()).len() as i32);
        }
        let lengths: Vec<i32> = found.iter().map(|[_, len]| part(*len as usize).len() as i32).collect();
        let ends = lengths.iter().scan(0, |end, len| {
            let start = *end;
            *end += len;
            Some(start)
        });
        let starts: Vec<i32> = ends.collect();
        let mut bytes = vec![0_u8; lengths.iter().map(|len| *len as usize).sum::<usize>().max(1)];
        world.all_to_all_varcount_into(
            &Partition::new(sent.as_slice(), counts, places),
            &mut PartitionMut::new(bytes.as_mut_slice(), lengths.as_slice(), starts.as_slice()),
        );
        for ((to, start), len) in received.iter_mut().zip(&starts).zip(&lengths) {
            to.extend_from_slice(&bytes[*start as usize..(*start + *len) as usize]);
        }
    }
    (Answer::Messages(received), false)
}

impl Mpi {
    /// The answer to letters; `None` if there is none, and never will be.
    fn ask(&self, letters: Letters) -> Option<Answer> {
        let mut place = self.post.lock().unwrap_or_else(PoisonError::into_inner);
        let post = place.take()?;
        post.to.send(letters).ok()?;
        let patience = if self.rank == 0 { PATIENCE } else { PATIENCE_OF_OTHERS };
        let mut asked_to_stop: Option<Instant> = None;
        let answer = loop {
            match post.from.recv_timeout(LOOK) {
                Ok(answer) => break answer,
                Err(RecvTimeoutError::Disconnected) => return None,
                Err(RecvTimeoutError::Timeout) => {}
            }
            if world::interrupted() && asked_to_stop.get_or_insert_with(Instant::now).elapsed() > patience {
                return None;
            }
        };
        *place = Some(post);
        Some(answer)
    }

    fn messages(&self, letters: Letters) -> Result<Vec<Vec<u8>>, Lost> {
        if self.is_over.load(Ordering::Relaxed) {
            return Err(Lost);
        }
        match self.ask(letters) {
            Some(Answer::Messages(messages)) => Ok(messages),
            Some(Answer::Ended(ranks)) => {
                tell_lost(&ranks, self.count);
                self.is_over.store(true, Ordering::Relaxed);
                Err(Lost)
            }
            None => Err(Lost),
        }
    }
}

impl Link for Mpi {
    fn rank(&self) -> usize {
        self.rank
    }

    fn count(&self) -> usize {
        self.count
    }

    fn neighbours(&self) -> usize {
        self.neighbours
    }

    fn exchange(&self, messages: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
        self.messages(Letters::Each(messages))
    }

    fn share(&self, message: Vec<u8>) -> Result<Vec<Vec<u8>>, Lost> {
        self.messages(Letters::Same(message))
    }

    fn end(&self) -> bool {
        let have_all = |answer| matches!(answer, Some(Answer::Ended(ranks)) if ranks.len() == self.count);
        // Where one has come to its end before others, all of them know, and have nothing more to do but to end: it waits for that.
        let together = !self.is_over.load(Ordering::Relaxed) && have_all(self.ask(Letters::End));
        let in_order = together || have_all(self.ask(Letters::End));
        // (Not after Ctrl-C: `mpirun` is about to kill them all, and does not answer meanwhile.)
        if in_order
            && !world::interrupted()
            && let Some(post) = self.post.lock().unwrap_or_else(PoisonError::into_inner).take()
        {
            // MPI is left in order before the process ends: the other thread answers nothing more, and is gone then.
            drop(post.to);
            let _ = post.from.recv();
        }
        together
    }
}
