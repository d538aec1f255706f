"""Infrastructure: command lines, worker processes, atomic files, resumable folders, parsers.

From the command line to the results:

- `errors`: error messages of one line, used by most of the others.
- `command_line`: commands, which parse their options and report each error in one line.
- `options`: classes of settings whose fields are options of a command.
- `input_file`, `plain_json`, `plain_yaml`, `plain_npz`: read files that nobody has checked.
- `progress`: a bar in a terminal, sparse lines in a log file.
- `workers`: parallel work, in processes or on a cluster.
- `atomic_file`: writes a file whole or not at all.
- `resumable`: the folder of a computation that continues after an interruption.
- `environment`: machine, packages and commit that results were made with.
- `results_file`: writes and reads the results of a command.
- `markdown`: tables of results.
"""
