// What nodes7 says in each session: node talk_nodes7.js CONVERSATION PORT [ARGUMENT ...]
// nodes7 merges neighbouring variables into one item and puts items into as few PDUs as fit.
// What a read gave is printed, a line of JSON each: {"bad": whether any value is, "values": by tag}.
"use strict";
const NodeS7 = require("nodes7");

const TAGS = {
  real: "DB2,REAL16",
  int: "DB2,INT4",
  word: "DB2,WORD6",
  dint: "DB2,DINT8",
  bit: "DB2,X0.0",
  far: "DB1,BYTE500",
  bytes: "DB1,BYTE10.20",
  text: "DB2,S20.6",
  flag: "MW20",
  flagBit: "M10.3",
  input: "IB4",
  output: "QW6",
  timer: "T5",
  counter: "C3",
};

const connection = new NodeS7({ silent: true });
const [conversation, port, rest] = [process.argv[2], Number(process.argv[3]), process.argv.slice(4)];

function fail(what) {
  console.error(what);
  process.exit(1);
}

function connect(then, options) {
  const parameters = { port, host: "127.0.0.1", rack: 0, slot: 2, timeout: 20000, ...options };
  connection.initiateConnection(parameters, (error) => {
    if (error) fail(error);
    then();
  });
}

function readAll(then, mayFail) {
  connection.readAllItems((bad, values) => {
    console.log(JSON.stringify({ bad, values }));
    if (bad && !mayFail) fail(`bad values: ${JSON.stringify(values)}`);
    then(bad);
  });
}

function quit() {
  connection.dropConnection(() => setTimeout(() => process.exit(0), 100));
}

function addTags(names) {
  connection.setTranslationCB((tag) => TAGS[tag] || tag);
  connection.addItems(names);
}

function poll(rounds, mayFail) {
  if (rounds === 0) quit();
  else readAll(() => setTimeout(() => poll(rounds - 1, mayFail), 50), mayFail);
}

function write(steps) {
  if (steps.length === 0) return quit();
  const [names, values] = steps[0];
  const started = connection.writeItems(names, values, (bad) => {
    if (bad) fail(`not written: ${names}`);
    setTimeout(() => write(steps.slice(1)), 50);
  });
  if (started) fail(`write not started: ${started}`);
}

function pollUntilGood(rounds) {
  readAll((bad) => {
    if (bad && rounds > 1) setTimeout(() => pollUntilGood(rounds - 1), 50);
    else quit();
  }, true);
}

const CONVERSATIONS = {
  poll() {
    connect(() => {
      addTags(Object.keys(TAGS));
      poll(5);
    });
  },
  // Every variable its own item.
  "poll-unmerged"() {
    connect(() => {
      addTags(Object.keys(TAGS));
      poll(2);
    }, { doNotOptimize: true });
  },
  // More than one PDU holds: several jobs open at once, as far as the server granted.
  "poll-parallel"() {
    connect(() => {
      addTags(["DB1,BYTE0.190", "DB1,BYTE200.190", "DB1,BYTE400.190", "DB10,BYTE0.64", "MB0.128", "IB0.128", "QB0.128"]);
      poll(3);
    });
  },
  "poll-missing"() {
    connect(() => {
      addTags(["int", "flag", "DB99,INT0", "DB2,REAL400"]);
      poll(2, true);
    });
  },
  write() {
    connect(() => {
      addTags(Object.keys(TAGS));
      write([
        ["real", 12.5],
        ["int", -7],
        ["bit", false],
        [["word", "dint", "flag"], [4711, -100000, 99]],
        [["flagBit", "output"], [true, 513]],
        ["text", "Valve"],
      ]);
    });
  },
  // No session, but what the tests of the fake PLC need: MILLISECONDS to wait for an answer, ROUNDS at most, TAG ...
  until(timeout, rounds, ...tags) {
    connect(() => {
      addTags(tags);
      pollUntilGood(Number(rounds));
    }, { timeout: Number(timeout) });
  },
  // The same: TAG, the VALUE to write (JSON), and the tag is read before and behind.
  back(tag, value) {
    connect(() => {
      addTags([tag]);
      readAll(() => {
        const started = connection.writeItems(tag, JSON.parse(value), (bad) => {
          if (bad) fail(`not written: ${tag}`);
          poll(1);
        });
        if (started) fail(`write not started: ${started}`);
      });
    });
  },
};

CONVERSATIONS[conversation](...rest);
