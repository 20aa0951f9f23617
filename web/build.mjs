// Bundle the page: dist/index.html with its files beside it, dist/piano.html with everything in it,
// dist/parity.mjs for the tests of Python.
import { build } from "esbuild";
