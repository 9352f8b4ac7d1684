//! Wall time, the process's CPU time, and dates.

use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Wall and CPU time since a moment.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    wall: Instant,
    cpu: Option<f64>,
}

/// Seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Elapsed {
    /// Wall time.
    pub wall: f64,
    /// CPU time of all threads together.
    pub cpu: f64,
}

impl Stopwatch {
    /// One that starts now.
    pub fn start() -> Stopwatch {
        Stopwatch { wall: Instant::now(), cpu: cpu_seconds() }
    }

    /// CPU time is that of the process, summed over all threads. If the operating system does not give it (other than Linux), it is
    /// estimated by the wall time multiplied by the number of worker threads, an upper bound.
    pub fn elapsed(&self) -> Elapsed {
        let wall = self.wall.elapsed().as_secs_f64();
        let cpu = match (self.cpu, cpu_seconds()) {
            (Some(before), Some(now)) => (now - before).max(0.0),
            _ => wall * rayon::current_num_threads() as f64,
        };
        Elapsed { wall, cpu }
    }
}

/// Where the wall time of a step went, and that between it and the step before, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Phases {
    /// Values: of renderings and of the loss.
    pub render: f64,
    /// Derivatives.
    pub gradient: f64,
    /// The rest of the step.
    pub solver: f64,
    /// Files that were written before the step: the log, checkpoints, what is saved.
    pub files: f64,
    /// What else was done before the step: `every` blocks.
    pub actions: f64,
}

impl Phases {
    /// All of them with their names in the log.
    pub(crate) fn named(&self) -> [(&'static str, f64); 5] {
        let Phases { render, gradient, solver, files, actions } = *self;
        [("render", render), ("gradient", gradient), ("solver", solver), ("files", files), ("actions", actions)]
    }
}

/// Seconds since 1970.
pub fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// CPU time of this process so far: the sum of the threads' scheduler statistics (in nanoseconds) or, if there are none, the process
/// statistics (in clock ticks of 10 ms).
pub fn cpu_seconds() -> Option<f64> {
    let nanoseconds = |task: std::fs::DirEntry| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    let tasks = std::fs::read_dir("/proc/self/task").ok()?;
    let total: f64 = tasks.flatten().filter_map(nanoseconds).sum();
    if total > 0.0 { Some(total * 1e-9) } else { ticks_from_stat(&std::fs::read_to_string("/proc/self/stat").ok()?) }
}

/// User and system time of a `/proc/self/stat` line, in seconds. The second field is the process's name in brackets
/// and may hold anything.
fn ticks_from_stat(stat: &str) -> Option<f64> {
    const TICKS_PER_SECOND: f64 = 100.0;
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace().skip(11);
    let user: f64 = fields.next()?.parse().ok()?;
    let system: f64 = fields.next()?.parse().ok()?;
    Some((user + system) / TICKS_PER_SECOND)
}

/// A moment in UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Date {
    /// In the proleptic Gregorian calendar.
    pub year: i64,
    /// From 1.
    pub month: u32,
    /// Of the month, from 1.
    pub day: u32,
    /// From 0 to 23.
    pub hour: u32,
    /// From 0 to 59.
    pub minute: u32,
    /// From 0 to 59.
    pub second: u32,
}

impl Date {
    /// The present moment, by the clock of the system.
    pub(crate) fn now() -> Date {
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
        Date::from_unix(seconds)
    }

    /// From seconds since 1970, by the proleptic Gregorian calendar.
    pub fn from_unix(seconds: u64) -> Date {
        let (days, second_of_day) = ((seconds / 86_400) as i64, (seconds % 86_400) as u32);
        // Counts years from March, so that the leap day comes last. Eras have 400 years = 146,097 days.
        let shifted = days + 719_468;
        let era = shifted.div_euclid(146_097);
        let day_of_era = shifted.rem_euclid(146_097);
        let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
        let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let march_month = (5 * day_of_year + 2) / 153;
        let day = (day_of_year - (153 * march_month + 2) / 5 + 1) as u32;
        let month = if march_month < 10 { march_month + 3 } else { march_month - 9 } as u32;
        let year = year_of_era + era * 400 + i64::from(month <= 2);
        let (hour, minute, second) = (second_of_day / 3600, second_of_day / 60 % 60, second_of_day % 60);
        Date { year, month, day, hour, minute, second }
    }

    /// `20261121-093312`: sorts by time, fits a file name.
    pub fn stamp(&self) -> String {
        let Date { year, month, day, hour, minute, second } = self;
        format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
    }

    /// `2026-11-21T09:33:12Z`
    pub fn iso(&self) -> String {
        let Date { year, month, day, hour, minute, second } = self;
        format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
    }
}

/// `95 ms`, `12.4 s`, `3 min 20 s`.
pub fn human_seconds(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() || s < 0.0 => "–".to_owned(),
        s if s < 1e-3 => format!("{:.0} µs", s * 1e6),
        s if s < 1.0 => format!("{:.0} ms", s * 1e3),
        s if s < 60.0 => format!("{s:.1} s"),
        s if s < 3600.0 => format!("{} min {:02} s", s as u64 / 60, s as u64 % 60),
        s => format!("{} h {:02} min", s as u64 / 3600, s as u64 / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_follow_the_calendar() {
        assert_eq!(Date::from_unix(0).iso(), "1970-01-01T00:00:00Z");
        assert_eq!(Date::from_unix(951_827_696).iso(), "2000-02-29T12:34:56Z");
        assert_eq!(Date::from_unix(1_709_164_800).iso(), "2024-02-29T00:00:00Z");
        assert_eq!(Date::from_unix(1_735_689_599).stamp(), "20241231-235959");
        assert_eq!(Date::from_unix(4_107_542_400).iso(), "2100-03-01T00:00:00Z", "2100 has no leap day");
    }

    #[test]
    fn cpu_time_counts_work() {
        let watch = Stopwatch::start();
        let mut x = 1.0_f64;
        // However little of the processor this thread gets.
        while watch.elapsed().cpu < 0.02 && watch.elapsed().wall < 60.0 {
            x = std::hint::black_box(x.sin() + 1.0);
        }
        let elapsed = watch.elapsed();
        assert!(x.is_finite() && elapsed.cpu >= 0.02, "{elapsed:?}");
    }

    #[test]
    fn a_process_may_be_called_anything() {
        let line = "42 (a) b (c) R 1 2 3 4 5 6 7 8 9 10 250 50 0 0 20 0 3 0";
        assert_eq!(ticks_from_stat(line), Some(3.0));
        assert_eq!(ticks_from_stat("nonsense"), None);
    }

    #[test]
    fn times_for_people() {
        assert_eq!(human_seconds(0.0953), "95 ms");
        assert_eq!(human_seconds(12.44), "12.4 s");
        assert_eq!(human_seconds(200.0), "3 min 20 s");
        assert_eq!(human_seconds(f64::NAN), "–");
    }
}
