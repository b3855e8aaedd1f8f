//! Items as the tasks of arrays, whose ids have to be below Slurm's limit.

/// Items `base + task` for each of `tasks`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobArray {
    /// The item of task 0.
    pub base: usize,
    /// Task ids, rising.
    pub tasks: Vec<usize>,
}

impl JobArray {
    /// Puts `items`, which rise, into arrays in which every id is below `limit`.
    pub(super) fn of(items: &[usize], limit: usize) -> Vec<Self> {
        let limit = limit.max(1);
        let same = |a: &usize, b: &usize| a / limit == b / limit;
        let array = |chunk: &[usize]| {
            let base = chunk[0] / limit * limit;
            Self { base, tasks: chunk.iter().map(|item| item - base).collect() }
        };
        items.chunk_by(same).map(array).collect()
    }

    /// Returns the ids as ranges, such as `0-3,7,9-12`.
    pub(super) fn ranges(&self) -> String {
        let runs = self.tasks.chunk_by(|a, b| a + 1 == *b);
        let range = |run: &[usize]| match run {
            [one] => one.to_string(),
            run => format!("{}-{}", run[0], run[run.len() - 1]),
        };
        runs.map(range).collect::<Vec<_>>().join(",")
    }

    /// Returns the first and the last item.
    pub(super) fn ends(&self) -> (usize, usize) {
        let end = |task: Option<&usize>| self.base + task.copied().unwrap_or(0);
        (end(self.tasks.first()), end(self.tasks.last()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_stay_below_the_limit_and_name_the_items() {
        let items = [0, 1, 2, 5, 9, 10, 19, 20];
        let arrays = JobArray::of(&items, 10);
        let ranges: Vec<(usize, String)> = arrays.iter().map(|array| (array.base, array.ranges())).collect();
        assert_eq!(ranges, [(0, "0-2,5,9".to_owned()), (10, "0,9".to_owned()), (20, "0".to_owned())]);
        assert_eq!(arrays[1].ends(), (10, 19));
        let again: Vec<usize> =
            arrays.iter().flat_map(|array| array.tasks.iter().map(move |task| array.base + task)).collect();
        assert_eq!(again, items);
        assert!(JobArray::of(&[], 10).is_empty());
        assert_eq!(JobArray::of(&items, usize::MAX).len(), 1);
    }
}
