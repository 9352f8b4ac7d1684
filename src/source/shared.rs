//! Lists that grow at their end and of which many copies are kept, such as those of a program before and after each line of a session.

use std::borrow::Borrow;
use std::collections::HashMap;
use std::hash::Hash;
use std::ops::{Index, IndexMut};
use std::sync::Arc;

/// Items that are shared or copied together.
const CHUNK: usize = 64;

/// A list whose copies share what they have in common. A copy costs nothing, and an item that is added to one or changed in it costs a
/// chunk, however long the list is.
#[derive(Clone, Debug)]
pub struct Shared<T> {
    /// Chunks of `CHUNK` items.
    full: Arc<Vec<Arc<Vec<T>>>>,
    /// The items behind these, fewer than `CHUNK`.
    last: Arc<Vec<T>>,
}

impl<T> Default for Shared<T> {
    fn default() -> Shared<T> {
        Shared { full: Arc::default(), last: Arc::default() }
    }
}

impl<T> Shared<T> {
    /// How many items it has.
    pub fn len(&self) -> usize {
        self.full.len() * CHUNK + self.last.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The item at an index, if there is one.
    pub fn get(&self, at: usize) -> Option<&T> {
        self.full.get(at / CHUNK).unwrap_or(&self.last).get(at % CHUNK).filter(|_| at < self.len())
    }

    /// All items in order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &T> + Clone {
        self.full.iter().flat_map(|chunk| chunk.iter()).chain(self.last.iter())
    }

    /// The indices of items which the other list may not have in the same place: of all that the two do not share.
    pub fn unshared<'a>(&'a self, other: &'a Shared<T>) -> impl Iterator<Item = usize> + 'a {
        let is_shared = move |chunk: usize| match (self.full.get(chunk), other.full.get(chunk)) {
            (Some(own), Some(others)) => Arc::ptr_eq(own, others),
            _ => false,
        };
        (0..=self.full.len())
            .filter(move |chunk| !is_shared(*chunk))
            .flat_map(move |chunk| chunk * CHUNK..self.len().min((chunk + 1) * CHUNK))
    }
}

impl<T: Clone> Shared<T> {
    /// Adds an item at the end.
    pub fn push(&mut self, item: T) {
        let last = Arc::make_mut(&mut self.last);
        last.push(item);
        if last.len() == CHUNK {
            Arc::make_mut(&mut self.full).push(std::mem::take(&mut self.last));
        }
    }
}

impl<T> Index<usize> for Shared<T> {
    type Output = T;

    fn index(&self, at: usize) -> &T {
        match self.full.get(at / CHUNK) {
            Some(chunk) => &chunk[at % CHUNK],
            None => &self.last[at - self.full.len() * CHUNK],
        }
    }
}

impl<T: Clone> IndexMut<usize> for Shared<T> {
    fn index_mut(&mut self, at: usize) -> &mut T {
        match at / CHUNK < self.full.len() {
            true => &mut Arc::make_mut(&mut Arc::make_mut(&mut self.full)[at / CHUNK])[at % CHUNK],
            false => &mut Arc::make_mut(&mut self.last)[at - self.full.len() * CHUNK],
        }
    }
}

impl<T: Clone> FromIterator<T> for Shared<T> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Shared<T> {
        let mut all = Shared::default();
        items.into_iter().for_each(|item| all.push(item));
        all
    }
}

/// A map whose copies share what they have in common. A copy costs nothing, and an entry that is added to one costs about the square root of
/// their number.
#[derive(Clone, Debug)]
pub struct SharedMap<K, V> {
    old: Arc<HashMap<K, V>>,
    /// Those added or replaced since, of which there are few.
    new: Arc<HashMap<K, V>>,
    len: usize,
}

impl<K, V> Default for SharedMap<K, V> {
    fn default() -> SharedMap<K, V> {
        SharedMap { old: Arc::default(), new: Arc::default(), len: 0 }
    }
}

impl<K: Hash + Eq, V> SharedMap<K, V> {
    /// The value of a key.
    pub fn get<Q: Hash + Eq + ?Sized>(&self, key: &Q) -> Option<&V>
    where
        K: Borrow<Q>,
    {
        self.new.get(key).or_else(|| self.old.get(key))
    }

    /// Whether a key has a value.
    pub fn contains_key<Q: Hash + Eq + ?Sized>(&self, key: &Q) -> bool
    where
        K: Borrow<Q>,
    {
        self.get(key).is_some()
    }

    /// All entries, in no order.
    pub fn iter(&self) -> impl Iterator<Item = (&K, &V)> {
        self.new.iter().chain(self.old.iter().filter(|(key, _)| !self.new.contains_key(*key)))
    }

    /// All keys, in no order.
    pub fn keys(&self) -> impl Iterator<Item = &K> {
        self.iter().map(|(key, _)| key)
    }

    /// How many entries it has.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

impl<K: Hash + Eq + Clone, V: Clone> SharedMap<K, V> {
    /// Gives a key a value.
    pub fn insert(&mut self, key: K, value: V) {
        self.len += usize::from(!self.contains_key(&key));
        let new = Arc::make_mut(&mut self.new);
        new.insert(key, value);
        if new.len() > CHUNK && new.len().pow(2) > self.old.len() {
            Arc::make_mut(&mut self.old).extend(std::mem::take(new));
        }
    }

    /// Keeps the entries of some keys only.
    pub fn retain(&mut self, keep: impl Fn(&K) -> bool) {
        for part in [&mut self.old, &mut self.new] {
            if part.keys().any(|key| !keep(key)) {
                Arc::make_mut(part).retain(|key, _| keep(key));
            }
        }
        self.len = self.iter().count();
    }
}

/// A set of small numbers whose copies share what they have in common. A copy costs nothing, and to unite two sets takes no longer than there are
/// chunks in which they differ.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct SharedSet(Arc<Vec<Option<Arc<Bits>>>>);

/// Which numbers of a chunk are in a set.
type Bits = [u64; WORDS];

const WORDS: usize = 8;
const BITS: usize = 64 * WORDS;

impl SharedSet {
    /// Whether it has no number.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether a number is in it.
    pub fn contains(&self, number: u32) -> bool {
        let at = number as usize;
        let chunk = self.0.get(at / BITS).and_then(Option::as_ref);
        chunk.is_some_and(|bits| bits[at % BITS / 64] >> (at % 64) & 1 == 1)
    }

    /// Adds a number.
    pub fn insert(&mut self, number: u32) {
        let at = number as usize;
        if self.contains(number) {
            return;
        }
        let chunks = Arc::make_mut(&mut self.0);
        chunks.resize(chunks.len().max(at / BITS + 1), None);
        let bits = Arc::make_mut(chunks[at / BITS].get_or_insert_default());
        bits[at % BITS / 64] |= 1 << (at % 64);
    }

    /// The numbers of both.
    pub fn union(&self, other: &SharedSet) -> SharedSet {
        if other.is_empty() || Arc::ptr_eq(&self.0, &other.0) {
            return self.clone();
        }
        let chunk = |set: &SharedSet, i: usize| set.0.get(i).cloned().flatten();
        let count = self.0.len().max(other.0.len());
        let all: Vec<_> = (0..count).map(|i| united(chunk(self, i), chunk(other, i))).collect();
        // Where one of the two has the other's numbers too, it goes on to be shared.
        let is_same = |set: &SharedSet| set.0.len() == count && (0..count).all(|i| is_shared(&all[i], &set.0[i]));
        match [self, other].into_iter().find(|set| is_same(set)) {
            Some(set) => set.clone(),
            None => SharedSet(Arc::new(all)),
        }
    }

    /// Whether all its numbers are in the other one.
    pub fn is_within(&self, other: &SharedSet) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.union(other) == *other
    }

    /// The numbers that are in the other one too.
    pub fn intersection(&self, other: &SharedSet) -> SharedSet {
        if Arc::ptr_eq(&self.0, &other.0) {
            return self.clone();
        }
        self.iter().filter(|number| other.contains(*number)).collect()
    }

    /// All numbers, in ascending order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = u32> + '_ {
        let bits = |i: usize| self.0[i].iter().flat_map(move |_| i * BITS..(i + 1) * BITS);
        (0..self.0.len()).flat_map(bits).map(|at| at as u32).filter(|number| self.contains(*number))
    }
}

impl FromIterator<u32> for SharedSet {
    fn from_iter<I: IntoIterator<Item = u32>>(numbers: I) -> SharedSet {
        let mut all = SharedSet::default();
        numbers.into_iter().for_each(|number| all.insert(number));
        all
    }
}

fn is_shared(a: &Option<Arc<Bits>>, b: &Option<Arc<Bits>>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (a, b) => a.is_none() && b.is_none(),
    }
}

fn united(a: Option<Arc<Bits>>, b: Option<Arc<Bits>>) -> Option<Arc<Bits>> {
    let (a, b) = match (a, b) {
        (Some(a), Some(b)) if !Arc::ptr_eq(&a, &b) => (a, b),
        (a, b) => return a.or(b),
    };
    let both: Bits = std::array::from_fn(|i| a[i] | b[i]);
    Some([&a, &b].into_iter().find(|one| ***one == both).cloned().unwrap_or_else(|| Arc::new(both)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_share_what_they_have_in_common() {
        for n in [0, 1, CHUNK - 1, CHUNK, CHUNK + 1, 3 * CHUNK + 5] {
            let list: Shared<usize> = (0..n).collect();
            assert_eq!((list.len(), list.is_empty()), (n, n == 0));
            assert!(list.iter().copied().eq(0..n) && list.iter().rev().copied().eq((0..n).rev()));
            assert!((0..n).all(|i| list[i] == i && list.get(i) == Some(&i)));
            assert_eq!((list.get(n), list.get(n + CHUNK)), (None, None));
            // What is added to a copy, and changed in it, is not in the list.
            let mut copy = list.clone();
            copy.push(n);
            copy[0] += 1;
            assert_eq!((list.len(), copy.len(), copy[n]), (n, n + 1, if n == 0 { 1 } else { n }));
            assert!(list.iter().copied().eq(0..n));
            // Changed are the first and the last chunk only.
            let unshared: Vec<usize> = copy.unshared(&list).collect();
            assert!((0..=n).all(|i| copy.get(i) == list.get(i) || unshared.contains(&i)), "{n}: {unshared:?}");
            assert!(unshared.len() <= 2 * CHUNK, "{n}: {}", unshared.len());
        }
    }

    #[test]
    fn copies_of_a_map_share_what_they_have_in_common() {
        let mut map = SharedMap::default();
        for n in 0..1000_usize {
            let before = map.clone();
            map.insert(n.to_string(), n);
            map.insert("last".to_owned(), n);
            assert_eq!((map.get("last"), before.contains_key(n.to_string().as_str())), (Some(&n), false));
            assert_eq!((map.len(), before.len()), (n + 2, if n == 0 { 0 } else { n + 1 }));
        }
        let mut sum: Vec<usize> = map.iter().filter(|(key, _)| *key != "last").map(|(_, value)| *value).collect();
        sum.sort_unstable();
        assert!(sum.into_iter().eq(0..1000));
        let all = map.clone();
        map.retain(|key| key.ends_with(['0', '2', '4', '6', '8']));
        assert_eq!((map.len(), all.len(), map.keys().count()), (500, 1001, 500));
        assert_eq!((map.get("998"), map.get("999"), map.get("last")), (Some(&998), None, None));
    }

    #[test]
    fn sets_are_united_and_share_what_they_have_in_common() {
        let of = |step: u32, n: u32| (0..n).step_by(step as usize).collect::<SharedSet>();
        for (n, m) in [(0, 0), (0, 5), (1, 2000), (2000, 2000), (3000, 600)] {
            let (evens, threes) = (of(2, n), of(3, m));
            let wanted = |number: u32| number < n && number.is_multiple_of(2) || number < m && number.is_multiple_of(3);
            for both in [evens.union(&threes), threes.union(&evens)] {
                assert!(both.iter().eq((0..3000).filter(|number| wanted(*number))), "{n} {m}");
                assert!((0..3000).all(|number| both.contains(number) == wanted(number)));
                assert!(evens.is_within(&both) && both.union(&threes) == both);
                // What has all is shared and not made again.
                let all = [both.union(&evens), evens.union(&both)];
                assert!(both.is_empty() || all.iter().all(|all| Arc::ptr_eq(&all.0, &both.0)), "{n} {m}");
            }
            assert_eq!(evens.is_within(&threes), n < 3);
            assert!(evens.intersection(&threes).iter().eq((0..n.min(m)).filter(|number| number.is_multiple_of(6))));
            assert_eq!(
                (evens.is_empty(), threes.iter().next_back()),
                (n == 0, (0..m).rev().find(|i| i.is_multiple_of(3)))
            );
        }
    }
}
