// A board: MicroPython's WebAssembly port with the tracker's files in its file system.
//
//   node board.mjs FOLDER
//
// FOLDER/job.json names the files to copy there and the code to run, one call after another:
// MicroPython collects what is free only between calls. What is printed goes to FOLDER/out.txt,
// files that the code wrote in /out come back to FOLDER.

import fs from "node:fs";
import path from "node:path";
import { loadMicroPython } from "@micropython/micropython-webassembly-pyscript";

const folder = process.argv[2];
const job = JSON.parse(fs.readFileSync(path.join(folder, "job.json"), "utf8"));
const printed = [];
const board = await loadMicroPython({ heapsize: 256 * 1024, stdout: (line) => printed.push(line) });

for (const name of ["/lib", "/lib/analysis", "/lib/analysis/tracker", "/in", "/out"]) {
  board.FS.mkdir(name);
}
for (const [place, file] of Object.entries(job.files)) {
  board.FS.writeFile(place, fs.readFileSync(file));
}
let status = 0;
try {
  for (const step of job.steps) {
    do {
      board.runPython("import gc\ngc.collect()");
      board.runPython(step);
    } while (board.globals.get("again"));
  }
} catch (error) {
  printed.push(String(error.message ?? error)); // a traceback of MicroPython's
  status = 1;
}
for (const name of board.FS.readdir("/out").filter((name) => !name.startsWith("."))) {
  fs.writeFileSync(path.join(folder, name), board.FS.readFile("/out/" + name));
}
fs.writeFileSync(path.join(folder, "out.txt"), printed.join("\n") + "\n");
process.exit(status);
