//! One file for each subcommand: its arguments and what it does.

pub(crate) mod bench;
pub(crate) mod capture;
pub(crate) mod demo;
pub(crate) mod eval;
pub(crate) mod exp;
pub(crate) mod export;
pub(crate) mod list;
pub(crate) mod pretrain;
pub(crate) mod render;
pub(crate) mod reproduce;
pub(crate) mod results;
pub(crate) mod scene;
pub(crate) mod sweep;
pub(crate) mod sweep_item;
pub(crate) mod view;
pub(crate) mod weights;
