//! What the program and its pages share: orders on their way in, the present state of all that is shown on its way out.
//!
//! Nothing queues up for a page. It gets what is new since it last asked, and of each topic only the latest, so that one which reads slowly
//! sees fewer states and holds nothing up.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Deserialize;
use serde_json::Value;

use super::wake::Watched;
use crate::session::world;

/// Most orders that wait. Newer ones of a kind replace older ones, so that few ever do.
const MOST_ORDERS: usize = 64;
/// How long the end of the program waits for pages that have not said goodbye.
pub const FAREWELL: Duration = Duration::from_secs(5);

/// What a page asks for, or the disk.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Order {
    /// Look from there. The number comes back with the pictures that follow.
    View {
        number: u64,
        pose: Option<Pose>,
    },
    /// Another camera of the script.
    Camera {
        name: String,
    },
    /// In powers of two.
    Exposure {
        stops: f32,
    },
    /// A value for a param: all its numbers, angles in degrees.
    Set {
        name: String,
        values: Vec<f64>,
    },
    /// Params are back at their initial values.
    Reset,
    /// Show the derivative of the picture with respect to a number of a param, or none any more.
    Derivative {
        name: Option<String>,
        element: usize,
    },
    /// Begin the optimisation of that index in the script.
    Start {
        index: usize,
    },
    Pause,
    Resume,
    /// One step of an optimisation that is paused.
    Step,
    Stop,
    /// A file has changed: the script or an import or, if `read`, one that the script reads.
    #[serde(skip)]
    Changed {
        read: bool,
    },
}

/// Where the eye is and where it looks.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Pose {
    pub position: [f64; 3],
    pub look_at: [f64; 3],
    pub up: [f64; 3],
}

impl Order {
    /// How much an order interrupts.
    fn weight(&self) -> Weight {
        match self {
            Order::Changed { .. } | Order::Start { .. } | Order::Stop => Weight::Ends,
            Order::Exposure { .. } | Order::Pause | Order::Resume | Order::Step => Weight::Waits,
            _ => Weight::Looks,
        }
    }

    /// Whether a newer order makes an older one pointless.
    fn replaces(&self, older: &Order) -> bool {
        match (self, older) {
            (Order::Set { name: new, .. }, Order::Set { name: old, .. }) => new == old,
            // A file that was read may have changed as well as the script.
            (Order::Changed { read: new }, Order::Changed { read: old }) => new == old,
            _ => std::mem::discriminant(self) == std::mem::discriminant(older),
        }
    }
}

/// Work that an order of some weight interrupts. What is interrupted is done again, or is pointless.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Weight {
    Waits,
    Looks,
    Ends,
}

/// A topic, and what there is to tell of it, as JSON.
pub type News = (&'static str, Arc<str>);

/// A picture as a PNG file.
pub type Png = Arc<Vec<u8>>;

pub struct Hub {
    state: Mutex<State>,
    /// An order came, or it is time to end.
    asked: Condvar,
    /// A topic is new, or it is time to end.
    told: Condvar,
    /// A connection has ended.
    left: Condvar,
    /// Ends the engine's work.
    interrupt: Arc<AtomicBool>,
    /// A run is shown, which a page may stop as Ctrl-C does, and not change.
    is_run: bool,
}

struct State {
    orders: Vec<Order>,
    /// The least weight that interrupts the present work.
    interrupted_by: Weight,
    topics: BTreeMap<&'static str, (u64, Arc<str>)>,
    pngs: BTreeMap<&'static str, Png>,
    version: u64,
    pages: usize,
    connections: usize,
    closed: bool,
    over: bool,
    /// Files to look at for changes.
    files: Vec<Watched>,
}

impl Hub {
    pub fn new(interrupt: Arc<AtomicBool>, is_run: bool) -> Arc<Hub> {
        let state = State {
            orders: Vec::new(),
            interrupted_by: Weight::Ends,
            topics: BTreeMap::new(),
            pngs: BTreeMap::new(),
            version: 0,
            pages: 0,
            connections: 0,
            closed: false,
            over: false,
            files: Vec::new(),
        };
        Arc::new(Hub {
            state: Mutex::new(state),
            asked: Condvar::new(),
            told: Condvar::new(),
            left: Condvar::new(),
            interrupt,
            is_run,
        })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // No update of the state can be left half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    // ---- orders ----------------------------------------------------------------------------------------------------

    /// Passes an order on; returns whether there was room for it.
    pub fn ask(&self, order: Order) -> bool {
        if self.is_run && order.weight() == Weight::Ends {
            if order == Order::Stop {
                world::interrupt_flag().store(true, Ordering::SeqCst);
                self.wake();
            }
            return true;
        }
        let mut state = self.state();
        state.orders.retain(|older| !order.replaces(older));
        if state.orders.len() >= MOST_ORDERS {
            return false;
        }
        if order.weight() >= state.interrupted_by {
            self.interrupt.store(true, Ordering::SeqCst);
        }
        state.orders.push(order);
        self.asked.notify_all();
        true
    }

    /// The orders that wait. Without any, waits for some for that long. To obey them is work that only edits interrupt.
    pub fn take_orders(&self, patience: Duration) -> Vec<Order> {
        let state = self.state();
        let is_idle = |state: &mut State| state.orders.is_empty() && !world::interrupted();
        let (mut state, _) =
            self.asked.wait_timeout_while(state, patience, is_idle).unwrap_or_else(PoisonError::into_inner);
        let orders = std::mem::take(&mut state.orders);
        self.begin_in(&mut state, Weight::Ends);
        orders
    }

    /// Work begins that is interrupted by orders of this weight and above, and by Ctrl-C.
    pub fn begin(&self, interrupted_by: Weight) {
        self.begin_in(&mut self.state(), interrupted_by);
    }

    fn begin_in(&self, state: &mut State, interrupted_by: Weight) {
        state.interrupted_by = interrupted_by;
        let is_late = state.orders.iter().any(|order| order.weight() >= interrupted_by);
        self.interrupt.store(is_late || world::interrupted(), Ordering::SeqCst);
    }

    /// It is time to end.
    pub fn wake(&self) {
        let _state = self.state();
        self.interrupt.store(true, Ordering::SeqCst);
        self.asked.notify_all();
    }

    pub fn set_files(&self, files: Vec<Watched>) {
        self.state().files = files;
    }

    pub fn files(&self) -> Vec<Watched> {
        self.state().files.clone()
    }

    // ---- what is shown ---------------------------------------------------------------------------------------------

    /// Shows the pages something. What they know already is not sent again.
    pub fn tell(&self, topic: &'static str, content: &Value) {
        let text: Arc<str> = content.to_string().into();
        let mut state = self.state();
        if state.topics.get(topic).is_some_and(|(_, known)| *known == text) {
            return;
        }
        state.version += 1;
        let version = state.version;
        state.topics.insert(topic, (version, text));
        self.told.notify_all();
    }

    /// The same with a picture, which pages then fetch.
    pub fn tell_png(&self, topic: &'static str, content: &Value, png: Vec<u8>) {
        self.state().pngs.insert(topic, Arc::new(png));
        self.tell(topic, content);
    }

    pub fn png(&self, topic: &str) -> Option<Png> {
        self.state().pngs.get(topic).cloned()
    }

    /// What is new since a version, and the version now; `None` at the end. Waits for something, but not for longer than that.
    pub fn news(&self, since: u64, patience: Duration) -> Option<(u64, Vec<News>)> {
        let state = self.state();
        let is_old = |state: &mut State| state.version == since && !state.closed;
        let (state, _) = self.told.wait_timeout_while(state, patience, is_old).unwrap_or_else(PoisonError::into_inner);
        let mut news: Vec<_> = state.topics.iter().filter(|(_, (version, _))| *version > since).collect();
        if news.is_empty() && state.closed {
            return None;
        }
        news.sort_by_key(|(_, (version, _))| *version);
        Some((state.version, news.into_iter().map(|(topic, (_, text))| (*topic, text.clone())).collect()))
    }

    /// Counts a page that listens, until it is dropped.
    pub fn page(self: &Arc<Hub>) -> Page {
        self.state().pages += 1;
        Page(self.clone())
    }

    pub fn pages(&self) -> usize {
        self.state().pages
    }

    /// Counts a connection until it is dropped; `None` where there are as many as there may be.
    pub fn connect(self: &Arc<Hub>, most: usize) -> Option<Connection> {
        let mut state = self.state();
        if state.connections >= most {
            return None;
        }
        state.connections += 1;
        Some(Connection(self.clone()))
    }

    /// Nothing new will be shown.
    pub fn is_closed(&self) -> bool {
        self.state().closed
    }

    /// Nobody is answered any more.
    pub fn is_over(&self) -> bool {
        self.state().over
    }

    /// The end. Pages are told what they have not been told yet, fetch the last pictures and say goodbye; who does not is waited for only
    /// so long.
    pub fn close(&self) {
        let mut state = self.state();
        state.closed = true;
        self.told.notify_all();
        let is_left = |state: &mut State| state.connections > 0;
        let (mut state, _) =
            self.left.wait_timeout_while(state, FAREWELL, is_left).unwrap_or_else(PoisonError::into_inner);
        state.over = true;
    }
}

/// Something that is connected.
pub struct Connection(Arc<Hub>);

impl Drop for Connection {
    fn drop(&mut self) {
        self.0.state().connections -= 1;
        self.0.left.notify_all();
    }
}

/// A page that listens.
pub struct Page(Arc<Hub>);

impl Drop for Page {
    fn drop(&mut self) {
        self.0.state().pages -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const SOON: Duration = Duration::from_millis(1);

    fn view(number: u64) -> Order {
        Order::View { number, pose: None }
    }

    #[test]
    fn newer_orders_replace_older_ones() {
        let hub = Hub::new(Arc::default(), false);
        let set = |name: &str, x: f64| Order::Set { name: name.into(), values: vec![x] };
        for order in [view(1), set("a", 1.0), set("b", 1.0), view(2), set("a", 2.0), Order::Changed { read: false }] {
            assert!(hub.ask(order));
        }
        let left = hub.take_orders(SOON);
        assert_eq!(left, [set("b", 1.0), view(2), set("a", 2.0), Order::Changed { read: false }]);
        assert_eq!(hub.take_orders(SOON), []);
        for i in 0..MOST_ORDERS {
            assert!(hub.ask(set(&format!("p{i}"), 0.0)));
        }
        assert!(!hub.ask(set("one more", 0.0)));
    }

    #[test]
    fn orders_interrupt_what_they_outweigh() {
        let flag = Arc::new(AtomicBool::new(false));
        let hub = Hub::new(flag.clone(), false);
        let check = |work: Weight, order: Order, expected: bool| {
            hub.begin(work);
            hub.ask(order.clone());
            assert_eq!(flag.load(Ordering::SeqCst), expected, "{work:?} {order:?}");
            // An order that came before the work began counts as well.
            hub.begin(work);
            assert_eq!(flag.load(Ordering::SeqCst), expected, "{work:?} {order:?}");
            hub.take_orders(SOON);
        };
        check(Weight::Looks, view(1), true);
        check(Weight::Looks, Order::Exposure { stops: 1.0 }, false);
        check(Weight::Ends, view(1), false);
        check(Weight::Ends, Order::Changed { read: true }, true);
    }

    #[test]
    fn a_slow_page_gets_the_latest_of_each_topic_and_no_more() {
        let hub = Hub::new(Arc::default(), false);
        for i in 0..1000 {
            hub.tell("status", &json!(i));
        }
        hub.tell("log", &json!("x"));
        hub.tell("log", &json!("x"));
        let (version, news) = hub.news(0, SOON).unwrap();
        assert_eq!((version, news), (1001, vec![("status", "999".into()), ("log", "\"x\"".into())]));
        assert_eq!(hub.news(version, SOON), Some((version, vec![])));
        hub.close();
        assert_eq!(hub.news(version, SOON), None);
        assert!(hub.news(1000, SOON).is_some());
    }

    #[test]
    fn orders_are_read_strictly() {
        let read = |text: &str| serde_json::from_str::<Order>(text).ok();
        assert_eq!(read(r#"{"do": "pause"}"#), Some(Order::Pause));
        assert_eq!(read(r#"{"do": "view", "number": 3, "pose": null}"#), Some(view(3)));
        for wrong in [r#"{"do": "changed", "read": true}"#, r#"{"do": "exec"}"#, "{}", r#"{"do": "start"}"#] {
            assert_eq!(read(wrong), None, "{wrong}");
        }
    }
}
