// Prints, for each query, the first pages that the search of the built site finds, as JSON.
// node search.js SITE QUERY ...
"use strict";
const fs = require("fs"), path = require("path"), vm = require("vm");
const [site, ...queries] = process.argv.slice(2);
const nothing = { children: [], firstChild: null, addEventListener() {}, classList: { add() {} } };
const page = vm.createContext({
  console,
  document: {
    addEventListener() {}, getElementById: () => nothing, querySelectorAll: () => [],
    documentElement: { dataset: {} }, readyState: "loading",
  },
  DOCUMENTATION_OPTIONS: {}, SPHINX_HIGHLIGHT_ENABLED: false, window: {}, _: (text) => text, _ready() {},
});
const run = (name) => vm.runInContext(fs.readFileSync(path.join(site, name), "utf-8"), page);
["_static/language_data.js", "_static/searchtools.js"].forEach(run);
page.Stemmer = page.window.Stemmer;
run("searchindex.js");
page.queries = queries;
const found = vm.runInContext(
  `queries.map((query) => {
     const results = Search._performSearch(...Search._parseQuery(query)); // the best one comes last
     return [...new Set(results.reverse().map((result) => result[0]))].slice(0, 3);
   })`, page);
process.stdout.write(JSON.stringify(found));
