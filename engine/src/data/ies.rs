//! Photometric files (`.ies`, the standard IES LM-63 of 1986 to 2019): the intensity of a luminaire in measured directions.

use std::iter::Peekable;

use glam::DVec3;

use crate::memory;
use crate::stop::paced;
use crate::tape::Tensor;

/// What a file says of a luminaire.
#[derive(Debug)]
pub struct Photometry {
    kind: Kind,
    /// Ascending, in degrees.
    vertical: Vec<f64>,
    /// Ascending, in degrees.
    horizontal: Vec<f64>,
    /// In candela, with all factors of the file: for each horizontal angle those of all vertical angles.
    candela: Vec<f64>,
    /// What of the file is not done.
    pub notes: Vec<String>,
}

/// What the angles are about.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Vertical angles from straight down, horizontal ones about the vertical axis: indoor and road luminaires.
    C,
    /// Floodlights: horizontal angles towards the ends of the horizontal axis, vertical ones about it. (0, 0) is straight ahead.
    B,
    /// Headlamps: vertical angles towards the ends of the vertical axis, horizontal ones about it. (0, 0) is straight ahead.
    A,
}

/// A number of a file and the line on which it stands.
type Word<'a> = (usize, &'a str);

/// Reads numbers one after the other.
struct Numbers<'a, I: Iterator<Item = Word<'a>>> {
    words: Peekable<I>,
}

impl<'a, I: Iterator<Item = Word<'a>>> Numbers<'a, I> {
    fn next(&mut self, what: &str) -> Result<f64, String> {
        let (line, word) = self.words.next().ok_or_else(|| format!("the file ends where {what} should stand"))?;
        let number = word.parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| format!("line {line} has “{word}” where {what} should stand"))
    }

    fn count(&mut self, what: &str, most: usize) -> Result<usize, String> {
        let line = self.words.peek().map_or(0, |(line, _)| *line);
        let number = self.next(what)?;
        match number {
            n if n >= 1.0 && n <= most as f64 && n.fract() == 0.0 => Ok(n as usize),
            n => Err(format!("line {line} has {n} as {what}, which a file of this length cannot have")),
        }
    }

    fn list(&mut self, count: usize, what: &str) -> Result<Vec<f64>, String> {
        (0..count).map(|_| self.next(what)).collect()
    }

    fn angles(&mut self, count: usize, what: &str) -> Result<Vec<f64>, String> {
        let angles = self.list(count, what)?;
        match angles.windows(2).find(|pair| pair[0] >= pair[1]) {
            Some(pair) => Err(format!("{what} must ascend, and {} follows {}", pair[1], pair[0])),
            None => Ok(angles),
        }
    }
}

/// Reads a photometric file.
pub fn decode(bytes: &[u8]) -> Result<Photometry, String> {
    // A number of two bytes becomes one of eight.
    memory::ask(bytes.len() as u64 * 8).map_err(|e| e.to_string())?;
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate();
    let is_header = |line: &str| line.trim_start().to_uppercase().starts_with("IES");
    let version = text.lines().next().filter(|line| is_header(line)).map_or("", str::trim);
    let tilt = lines.by_ref().find_map(|(_, line)| line.trim().to_uppercase().strip_prefix("TILT=").map(str::to_owned));
    let Some(tilt) = tilt else { return Err("a photometric file has a line `TILT=…`, and this one has none".into()) };
    let parted = |c: char| c.is_whitespace() || c == ',';
    let words = lines.flat_map(|(i, line)| line.split(parted).filter(|w| !w.is_empty()).map(move |w| (i + 1, w)));
    let mut numbers = Numbers { words: words.peekable() };
    let most = bytes.len();
    let mut notes = Vec::new();
    match tilt.trim() {
        "NONE" => {}
        "INCLUDE" => {
            numbers.next("the lamp's position")?;
            let count = numbers.count("the number of tilts", most)?;
            let (_, factors) = (numbers.list(count, "a tilt")?, numbers.list(count, "a tilt's factor")?);
            if factors.iter().any(|f| *f != 1.0) {
                notes.push("the factors of tilted lamps are left out: the lamp is as it was measured".to_owned());
            }
        }
        other => notes.push(format!("the factors of tilted lamps in `{}` are left out", other.to_lowercase())),
    }
    numbers.next("the number of lamps")?;
    numbers.next("the luminous flux")?;
    let multiplier = numbers.next("the factor on intensities")?;
    let rows = numbers.count("the number of vertical angles", most)?;
    let columns = numbers.count("the number of horizontal angles", most / rows)?;
    let kind = match numbers.next("the photometric type")? {
        1.0 => Kind::C,
        2.0 => Kind::B,
        3.0 => Kind::A,
        other => return Err(format!("the photometric type is 1, 2 or 3, and this file has {other}")),
    };
    numbers.list(4, "the luminaire's size")?;
    let ballast = numbers.next("the ballast's factor")?;
    // From 2002 on the second number is not a factor, but says how the file was made.
    let second = numbers.next("the factor on lamp and ballast")?;
    let old = !["2002", "2019"].iter().any(|year| version.contains(year));
    numbers.next("the power in watts")?;
    let vertical = numbers.angles(rows, "vertical angles")?;
    let horizontal = numbers.angles(columns, "horizontal angles")?;
    let factor = multiplier * ballast * if old { second } else { 1.0 };
    let mut candela = numbers.list(rows * columns, "an intensity")?;
    candela.iter_mut().for_each(|c| *c *= factor);
    if candela.iter().any(|c| !c.is_finite()) {
        return Err("the intensities and their factors are too large".into());
    }
    if candela.iter().any(|c| *c < 0.0) {
        notes.push("negative intensities are taken as 0".to_owned());
        candela.iter_mut().for_each(|c| *c = c.max(0.0));
    }
    let photometry = Photometry { kind, vertical, horizontal, candela, notes };
    photometry.check()?;
    Ok(photometry)
}

impl Photometry {
    /// Checks that the angles cover what the standard says.
    fn check(&self) -> Result<(), String> {
        let ends = |angles: &[f64]| [angles[0], angles[angles.len() - 1]];
        let ([v0, v1], [h0, h1]) = (ends(&self.vertical), ends(&self.horizontal));
        let (vertical, horizontal) = match self.kind {
            Kind::C => (
                0.0 <= v0 && v1 <= 180.0,
                h0 == 0.0 && (h1 == 0.0 || h1 == 90.0 || (180.0..=360.0).contains(&h1)) || [h0, h1] == [90.0, 270.0],
            ),
            Kind::B | Kind::A => {
                let covers = |a: f64, b: f64| -90.0 <= a && b <= 90.0 && (a <= 0.0 && b >= 0.0);
                (covers(v0, v1), covers(h0, h1))
            }
        };
        let text = |what: &str, [a, b]: [f64; 2]| {
            format!("{what} angles from {a} to {b} do not say what the luminaire does all around")
        };
        match (vertical, horizontal) {
            (false, _) => Err(text("vertical", [v0, v1])),
            (_, false) => Err(text("horizontal", [h0, h1])),
            _ => Ok(()),
        }
    }

    /// The intensity in a unit direction of the luminaire's frame, in candela: interpolated between the measured angles, and 0 beyond them.
    /// −y is straight down; horizontal angles of type C start at +x and grow counterclockwise as seen from above, towards −z. What types A
    /// and B call straight ahead is straight down too, with +x to the right and −z upwards, so that a turn of 90° about +x makes the
    /// luminaire look along −z.
    pub fn intensity(&self, dir: DVec3) -> f64 {
        // Zeros become positive ones, whose arcus tangent is 0 too.
        let (ahead, up, right) = (0.0 - dir.y, 0.0 - dir.z, dir.x);
        let [vertical, horizontal] = match self.kind {
            Kind::C => [dir.x.hypot(dir.z).atan2(ahead), up.atan2(right)],
            Kind::B => [up.atan2(ahead), right.clamp(-1.0, 1.0).asin()],
            Kind::A => [up.clamp(-1.0, 1.0).asin(), right.atan2(ahead)],
        }
        .map(f64::to_degrees);
        // Of what is symmetric, only one side is written down.
        let mirrored = |angles: &[f64], angle: f64| between(angles, if angles[0] >= 0.0 { angle.abs() } else { angle });
        let (vertical, horizontal) = match self.kind {
            Kind::C => (between(&self.vertical, vertical), self.around(horizontal)),
            Kind::B | Kind::A => (mirrored(&self.vertical, vertical), mirrored(&self.horizontal, horizontal)),
        };
        let (Some(rows), Some(columns)) = (vertical, horizontal) else { return 0.0 };
        let at = |column: usize, row: usize| self.candela[column * self.vertical.len() + row];
        let along = |column: usize| at(column, rows.0[0]) * (1.0 - rows.1) + at(column, rows.0[1]) * rows.1;
        along(columns.0[0]) * (1.0 - columns.1) + along(columns.0[1]) * columns.1
    }

    /// The place of a horizontal angle of type C, which files of symmetric luminaires do not say all around.
    fn around(&self, angle: f64) -> Option<Place> {
        let angle = angle.rem_euclid(360.0);
        let (first, last) = (self.horizontal[0], self.horizontal[self.horizontal.len() - 1]);
        let folded = match (first, last) {
            (_, 0.0) => 0.0,
            (_, 90.0) if angle.rem_euclid(180.0) > 90.0 => 180.0 - angle.rem_euclid(180.0),
            (_, 90.0) => angle.rem_euclid(180.0),
            (_, 180.0) if angle > 180.0 => 360.0 - angle,
            (90.0, 270.0) if angle < 90.0 => 180.0 - angle,
            (90.0, 270.0) if angle > 270.0 => 540.0 - angle,
            // All around, perhaps without the last plane, which is the first.
            _ if angle > last => {
                return Some(([self.horizontal.len() - 1, 0], (angle - last) / (360.0 - last)));
            }
            _ => angle,
        };
        between(&self.horizontal, folded)
    }

    /// The intensities as an equirectangular map of one channel (`[height, width, 1]`, top row straight up), fine enough for the measured
    /// angles; a luminaire that is the same all around has one column.
    pub fn map(&self) -> Result<Tensor, String> {
        /// Texels between neighbouring angles, so that what lies between texels differs little from what lies between angles.
        const FINER: f64 = 4.0;
        const MOST_ROWS: f64 = 720.0;
        let step = |angles: &[f64]| angles.windows(2).map(|a| a[1] - a[0]).fold(180.0, f64::min);
        let texels = |range: f64, step: f64, most: f64| (FINER * range / step).ceil().clamp(4.0, most) as usize;
        let [vertical, horizontal] = [step(&self.vertical), step(&self.horizontal)];
        let (height, width) = match self.kind {
            Kind::C if self.horizontal.len() == 1 => (texels(180.0, vertical, MOST_ROWS), 1),
            Kind::C => (texels(180.0, vertical, MOST_ROWS), texels(360.0, horizontal, 2.0 * MOST_ROWS)),
            Kind::B | Kind::A => {
                let finest = vertical.min(horizontal);
                (texels(180.0, finest, MOST_ROWS), texels(360.0, finest, 2.0 * MOST_ROWS))
            }
        };
        memory::ask_for::<f64>(width * height).map_err(|e| e.to_string())?;
        let texel = |i: usize| {
            let uv = [(i % width) as f64 / width as f64, (i / width) as f64 / height as f64];
            let (phi, theta) = (
                (uv[0] + 0.5 / width as f64 - 0.5) * std::f64::consts::TAU,
                (uv[1] + 0.5 / height as f64) * std::f64::consts::PI,
            );
            self.intensity(DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos()))
        };
        let data = paced(0..width * height, 64).map(texel).collect();
        Ok(Tensor { shape: vec![height, width, 1], data })
    }
}

/// Two neighbouring angles, and the weight of the second.
type Place = ([usize; 2], f64);

/// Where an angle lies among ascending ones; `None` beyond them.
fn between(angles: &[f64], angle: f64) -> Option<Place> {
    // Directions are rounded: those of the last angle must not fall beyond it.
    const ROUNDING: f64 = 1e-9;
    let last = angles.len() - 1;
    if !(angle >= angles[0] - ROUNDING && angle <= angles[last] + ROUNDING) {
        return None;
    }
    let next = angles.partition_point(|a| *a <= angle).clamp(1.min(last), last);
    let before = next.saturating_sub(1);
    let width = angles[next] - angles[before];
    let weight = if width > 0.0 { ((angle - angles[before]) / width).clamp(0.0, 1.0) } else { 0.0 };
    Some(([before, next], weight))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of these angles in degrees, with an intensity for each pair of horizontal and vertical angle.
    fn file(kind: u8, vertical: &[f64], horizontal: &[f64], of: impl Fn(f64, f64) -> f64) -> String {
        let row = |numbers: Vec<f64>| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let candela: Vec<String> =
            horizontal.iter().map(|h| row(vertical.iter().map(|v| of(*v, *h)).collect())).collect();
        format!(
            "IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] us\nTILT=NONE\n1 1000 2 {} {} {kind} 2 0.1 0.1 0\n0.5 1 30\n{}\n{}\n{}\n",
            vertical.len(),
            horizontal.len(),
            row(vertical.to_vec()),
            row(horizontal.to_vec()),
            candela.join("\n"),
        )
    }

    fn of_c(vertical: f64, horizontal: f64) -> DVec3 {
        let (v, h) = (vertical.to_radians(), horizontal.to_radians());
        DVec3::new(v.sin() * h.cos(), -v.cos(), -v.sin() * h.sin())
    }

    fn close(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{found} {expected}");
    }

    #[test]
    fn symmetric_luminaires_are_completed() {
        let vertical = [0.0, 30.0, 90.0];
        // What each range of horizontal angles says of 200°, by the value of another angle.
        let cases: [(&[f64], f64); 6] = [
            (&[0.0], 0.0),
            (&[0.0, 45.0, 90.0], 20.0),
            (&[0.0, 90.0, 180.0], 160.0),
            (&[90.0, 180.0, 270.0], 200.0),
            (&[0.0, 90.0, 180.0, 270.0, 360.0], 200.0),
            (&[0.0, 120.0, 240.0], 200.0),
        ];
        for (horizontal, same) in cases {
            let text = file(1, &vertical, horizontal, |v, h| 10.0 + v + h);
            let lamp = decode(text.as_bytes()).unwrap();
            close(lamp.intensity(of_c(20.0, 200.0)), 10.0 + 20.0 + same);
            close(lamp.intensity(of_c(90.0, 200.0)), 10.0 + 90.0 + same);
            close(lamp.intensity(of_c(91.0, 200.0)), 0.0);
        }
        // Past the last of all planes the first one comes again.
        let lamp = decode(file(1, &vertical, &[0.0, 120.0, 240.0], |_, h| h).as_bytes()).unwrap();
        close(lamp.intensity(of_c(40.0, 300.0)), 120.0);
        // The plane through 90° and 270° divides what is the same on both sides of it.
        let lamp = decode(file(1, &vertical, &[90.0, 270.0], |_, h| h).as_bytes()).unwrap();
        close(lamp.intensity(of_c(40.0, 10.0)), 170.0);
        close(lamp.intensity(of_c(40.0, 350.0)), 190.0);
    }

    #[test]
    fn floodlights_and_headlamps_look_straight_down() {
        let angles = [-90.0, 0.0, 90.0];
        let [flood, head] =
            [2, 3].map(|kind| decode(file(kind, &angles, &angles, |v, h| 1000.0 + v + 10.0 * h).as_bytes()).unwrap());
        for lamp in [&flood, &head] {
            close(lamp.intensity(-DVec3::Y), 1000.0);
            close(lamp.intensity(DVec3::X), 1900.0);
            close(lamp.intensity(-DVec3::Z), 1090.0);
            close(lamp.intensity(DVec3::Y), 0.0);
        }
        // 60° up, and then 45° to the right about the axis that each type has.
        let (up, right) = (60_f64.to_radians(), 45_f64.to_radians());
        let tilted = DVec3::new(right.sin(), -right.cos() * up.cos(), -right.cos() * up.sin());
        close(flood.intensity(tilted), 1000.0 + 60.0 + 450.0);
        let turned = DVec3::new(up.cos() * right.sin(), -up.cos() * right.cos(), -up.sin());
        close(head.intensity(turned), 1000.0 + 60.0 + 450.0);
        // One half of what is symmetric.
        let half = decode(file(2, &[0.0, 90.0], &[0.0, 90.0], |v, h| v + h).as_bytes()).unwrap();
        close(half.intensity(-DVec3::X), 90.0);
        close(half.intensity(DVec3::Z), 90.0);
    }

    #[test]
    fn maps_hold_the_flux() {
        // A Lambertian luminaire, I = cos γ, sends π down; one that sends sin² γ (1 + sin C / 2) all around sends 8π / 3.
        let degrees = |step: usize, last: usize| (0..=last).step_by(step).map(|d| d as f64).collect::<Vec<f64>>();
        let cosine = file(1, &degrees(5, 90), &[0.0], |v, _| v.to_radians().cos());
        let lobes = file(1, &degrees(5, 180), &degrees(15, 360), |v, h| {
            v.to_radians().sin().powi(2) * (1.0 + 0.5 * h.to_radians().sin())
        });
        for (text, size, flux) in [(cosine, [144, 1], 1.0), (lobes, [144, 96], 8.0 / 3.0)] {
            let map = decode(text.as_bytes()).unwrap().map().unwrap();
            assert_eq!(map.shape, [size[0], size[1], 1]);
            let (height, width) = (size[0] as f64, size[1]);
            let edge = |y: usize| (std::f64::consts::PI * y as f64 / height).cos();
            let rows = map.data.chunks(width).enumerate();
            let sum: f64 = rows.map(|(y, row)| (edge(y) - edge(y + 1)) * row.iter().sum::<f64>() / width as f64).sum();
            assert!((2.0 * sum - flux).abs() < 2e-3 * flux, "{sum} {flux}");
        }
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let right = file(1, &[0.0, 90.0], &[0.0, 90.0], |_, _| 5.0);
        let says = |text: &str, what: &str| {
            let error = decode(text.as_bytes()).unwrap_err();
            assert!(error.contains(what), "{error}");
        };
        says(&right.replace("TILT=NONE", "none"), "TILT=");
        says(&right.replace("1 1000 2", "1 many 2"), "line 5 has “many” where the luminous flux");
        says(&right.replace("5 5\n5 5\n", "5 5\n5\n"), "the file ends where an intensity");
        says(&right.replace("1 1000 2 2 2", "1 1000 2 2 99999999999"), "line 5 has 99999999999");
        says(&right.replace("1 1000 2 2 2", "1 1000 2 2 1.5"), "line 5 has 1.5");
        says(&right.replace("\n0 90\n0 90", "\n90 0\n0 90"), "must ascend, and 0 follows 90");
        says(&right.replace("\n0 90\n0 90", "\n0 90\n0 120"), "horizontal angles from 0 to 120");
        says(&right.replace("\n0 90\n0 90", "\n-20 90\n0 90"), "vertical angles from -20");
        says(&right.replace("2 2 1 2 0.1", "2 2 4 2 0.1"), "1, 2 or 3");
        says("", "TILT=");
        says("TILT=NONE", "ends where the number of lamps");
        // Older files have a factor where newer ones say how they were made.
        let value = |text: &str| decode(text.as_bytes()).unwrap().intensity(-DVec3::Y);
        close(value(&right.replace("0.5 1 30", "0.5 1.1 30")), 5.0);
        close(value(&right.replace("0.5 1 30", "0.5 1.1 30").replace("2002", "1995")), 5.5);
        // What is not done is told.
        let tilted = right.replace("TILT=NONE", "TILT=INCLUDE\n1\n2\n0 90\n1 0.8").replace("5 5\n5 5", "5 5\n5 -1");
        let notes = decode(tilted.as_bytes()).unwrap().notes;
        assert!(notes.len() == 2 && notes[0].contains("tilted") && notes[1].contains("negative"), "{notes:?}");
    }
}
