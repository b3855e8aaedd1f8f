//! Records of runs, and the tables, charts and reports made from them.
//!
//! - [`Record`]: one run, an entry of `results.json`.
//! - [`ReportInput`]: records, claims and published figures of an experiment. [`write_report`] makes the `report.html` of
//!   one experiment, [`write_collection`] one of several, and [`results_document`] one Markdown document of several.
//! - [`Table`]: variants against scenes or metrics, mean ± standard deviation over seeds, best in bold, as Markdown,
//!   CSV or plain text, always below the [protocol](protocol_lines) that its numbers follow.
//! - [`Published`]: a paper's own figures, and [`Claim`]: a statement on the order of variants, tested on records.
//! - [`chart`]: small functions from numbers to an SVG string; [`panel`]: the comparison figure of papers.
//! - [`PictureComparison`]: a page of other programs' renders over the truth.
//! - [`write_tensorboard`]: training curves for TensorBoard.
//! - [`depth_image`], [`error_image`] and [`normal_image`]: images of depth, error and normals.
//!
//! ```
//! use infonerf_report::{Quantity, Record, scene_table};
//!
//! let run = |variant: &str, psnr| Record {
//!     scene: "lego".into(),
//!     variant: variant.into(),
//!     metrics: [("psnr".to_owned(), Some(psnr))].into_iter().collect(),
//!     ..Record::default()
//! };
//! let table = scene_table(&[run("nerf", 15.9), run("infonerf", 18.9)], Quantity::PSNR);
//! assert!(table.to_markdown().contains("| infonerf | **18.90** |"));
//! println!("{}", table.to_text());
//! ```

pub mod chart;
mod claim;
mod colormap;
mod comparison;
mod contents;
mod error;
mod events;
mod figures;
mod files;
mod gallery;
mod input;
mod interval;
mod markdown;
mod panel;
mod protocol;
mod published;
mod quantity;
mod record;
mod report;
mod table;
mod tensorboard;
mod text;
mod text_table;

pub use claim::{Claim, Comparison, Finding, Relation, Side, TestedClaim, Verdict};
pub use colormap::{depth_image, error_image, normal_image, turbo};
pub use comparison::PictureComparison;
pub use error::ReportError;
pub use events::{EVENTS_FILE, Events, StepEvent};
pub use figures::Figure;
pub use files::{save_png, write_atomically};
pub use gallery::picture_names;
pub use input::ReportInput;
pub use markdown::{WRITTEN_BY, results_document};
pub use panel::{Panel, panel};
pub use protocol::protocol_lines;
pub use published::{Published, PublishedRow};
pub use quantity::Quantity;
pub use record::{CameraErrors, Record, Setting, TestViews, VIEWER_PAGE, run_directory};
pub use report::{write_collection, write_report};
pub use table::{Cell, Column, Table, TableRow, overview_table, scene_table};
pub use tensorboard::{tensorboard_events, write_tensorboard};
pub use text::{counted, escape_html};
pub use text_table::TextTable;
