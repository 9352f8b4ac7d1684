//! The directional albedo of a lobe as a table: what it reflects of light from a cosine c with the normal, by its roughness. It is interpolated
//! linearly, so that derivatives in the roughness jump where the roughness is a multiple of 1 / 20.

/// Numbers of cells of a table along the cosine and along the roughness, both of which range from 0 to 1.
const COSINES: usize = 24;
const ROUGHNESSES: usize = 20;

type Rows = [[f32; COSINES + 1]; ROUGHNESSES + 1];

/// Albedos by roughness (rows) and cosine (columns), and their means over the hemisphere.
pub struct AlbedoTable {
    rows: Rows,
    means: [f32; ROUGHNESSES + 1],
}

/// An albedo, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Albedo {
    pub value: f32,
    pub by_c: f32,
    pub by_roughness: f32,
}

impl AlbedoTable {
    pub const fn new(rows: Rows) -> AlbedoTable {
        let mut means = [0.0; ROUGHNESSES + 1];
        let mut i = 0;
        while i <= ROUGHNESSES {
            // 2 ∫ E c dc, exact for the linear interpolation between nodes.
            let mut j = 0;
            while j < COSINES {
                let (c, h) = (j as f32 / COSINES as f32, 1.0 / COSINES as f32);
                let (a, b) = (rows[i][j], rows[i][j + 1]);
                means[i] += h * (c * (a + b) + h * (a + 2.0 * b) / 3.0);
                j += 1;
            }
            i += 1;
        }
        AlbedoTable { rows, means }
    }

    /// At the cosine `c`.
    pub fn directional(&self, c: f32, roughness: f32) -> Albedo {
        let (i, x) = cell(roughness, ROUGHNESSES);
        let (j, y) = cell(c, COSINES);
        let [[a, b], [c, d]] = [i, i + 1].map(|i| [self.rows[i][j], self.rows[i][j + 1]]);
        let (low, high) = (a + (b - a) * y, c + (d - c) * y);
        Albedo {
            value: low + (high - low) * x,
            by_c: ((b - a) * (1.0 - x) + (d - c) * x) * COSINES as f32,
            by_roughness: (high - low) * ROUGHNESSES as f32,
        }
    }

    /// The mean 2 ∫ E(c) c dc over the hemisphere.
    pub fn mean(&self, roughness: f32) -> Albedo {
        let (i, x) = cell(roughness, ROUGHNESSES);
        let (low, high) = (self.means[i], self.means[i + 1]);
        let by_roughness = (high - low) * ROUGHNESSES as f32;
        Albedo { value: low + (high - low) * x, by_c: 0.0, by_roughness }
    }
}

/// The index of the cell of `x` in [0, 1] divided into `cells`, and the position of `x` within it as a fraction.
fn cell(x: f32, cells: usize) -> (usize, f32) {
    let x = (x * cells as f32).clamp(0.0, cells as f32);
    let i = (x as usize).min(cells - 1);
    (i, x - i as f32)
}
