//! What a run notes for its report beside the log: lines of `report.jsonl`. All but seconds follow from the seed.

use serde::{Deserialize, Serialize};

use super::picture::Picture;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// An optimisation begins.
    Begin { of: String, total: u64, stages: Vec<Stage>, params: Vec<Bounds> },
    /// Another stage begins, which moves these params.
    Moves { params: Vec<Bounds> },
    /// An image of the loss at a step.
    Picture(Shown),
    /// What images are compared with, before the first one that is.
    Target { id: String, image: Picture },
    /// An optimisation has ended, where its loss is this.
    Optimized { of: String, steps: u64, loss: Option<f64>, error: Option<f64> },
    /// An error or a warning.
    Told {
        severity: String,
        code: String,
        message: String,
        place: Option<String>,
        labels: Vec<String>,
        help: Vec<String>,
    },
    /// Something else that the user was told.
    Note { text: String },
    /// The run has ended. Seconds are those since the last step, and among them what files took.
    End { how: Ending, seconds: f64, files: f64 },
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    pub name: Option<String>,
    /// Steps of this stage and of all before it.
    pub until: u64,
}

/// A param that moves, and where it may: a number for each of its own or one for all, none where there is no bound, nor where each of many
/// numbers has another. `space` says in which coordinates
/// it moves and what is believed of it beforehand, if that was said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    pub name: String,
    pub shape: Vec<usize>,
    pub lower: Option<Vec<Option<f64>>>,
    pub upper: Option<Vec<Option<f64>>>,
    pub space: Option<String>,
    /// What the script's `///` says of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doc: Option<String>,
}

/// An image that the loss has seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    pub of: String,
    /// Steps taken before it.
    pub step: u64,
    pub moment: Moment,
    /// The place of its comparison among those of the loss.
    pub view: usize,
    /// The expression.
    pub name: String,
    pub image: Picture,
    /// The [`Event::Target`] that it was compared with.
    pub target: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Moment {
    /// Before the first step.
    Start,
    /// Small, for the animation.
    Between,
    /// After the last step.
    End,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    Finished,
    /// An `expect` or an optimisation failed.
    Unsuccessful,
    Interrupted,
    /// Others of its sweep were better.
    Pruned,
    /// An error ended it.
    Failed,
}

impl Ending {
    /// In a word.
    pub fn word(self) -> &'static str {
        match self {
            Ending::Finished => "finished",
            Ending::Unsuccessful => "unsuccessful",
            Ending::Interrupted => "interrupted",
            Ending::Pruned => "pruned",
            Ending::Failed => "failed",
        }
    }

    /// In a few words.
    pub fn text(self) -> &'static str {
        match self {
            Ending::Finished => "finished",
            Ending::Unsuccessful => "finished, not as the script expects",
            Ending::Interrupted => "interrupted",
            Ending::Pruned => "pruned: others of its sweep were better",
            Ending::Failed => "ended by an error",
        }
    }
}
