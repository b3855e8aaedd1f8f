//! Tests of the command line, in one program.

mod bad_input;
mod capture;
mod cli;
mod common;
mod export;
mod gpu;
mod kills;
mod launch;
mod photographs;
mod pictures;
mod python;
mod reproduce;
mod slurm;
mod stress;
mod sweep;
