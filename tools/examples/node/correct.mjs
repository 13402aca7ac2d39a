// A simulation that fmucorrect logged, through the corrector, with ONNX Runtime for Node.js:
//
//     node correct.mjs corrector.onnx run.mcap corrected.csv
//
// Status: 0 corrected, 1 the window is not full yet, 2 outside of what the corrector was trained on.
import { open, readFile } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers, protobufFromBinaryDescriptor } from "@mcap/support";
import ort from "onnxruntime-node";
import protobuf from "protobufjs";

const TOPIC = "/simulation";
const BATCH = 1024; // windows in a call of ONNX Runtime
const [OK, WARMUP, OUTSIDE] = [0, 1, 2];

/** What a bundle says of itself. ONNX Runtime for JavaScript does not hand out metadata_props, but an ONNX file is one
 * protobuf message, and they are its field 14. */
function readInfo(model) {
  const entry = new protobuf.Type("Entry")
    .add(new protobuf.Field("key", 1, "string"))
    .add(new protobuf.Field("value", 2, "string"));
  const type = new protobuf.Type("Model").add(entry).add(new protobuf.Field("metadata", 14, "Entry", "repeated"));
  const found = type.decode(model).metadata.find(({ key }) => key === "fmucorrect");
  if (!found) throw new Error("this ONNX file is no corrector");
  return JSON.parse(found.value);
}

/** The log's condition, and its samples as [time in ns (BigInt), values of the channels]. */
async function openLog(file, channels) {
  const reader = await McapIndexedReader.Initialize({
    readable: new FileHandleReadable(file),
    decompressHandlers: await loadDecompressHandlers(),
  });
  const topic = [...reader.channelsById.values()].find((channel) => channel.topic === TOPIC);
  if (!topic) throw new Error(`the log has no topic ${TOPIC}`);
  const schema = reader.schemasById.get(topic.schemaId);
  const type = protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);

  const notes = topic.metadata; // of the channel: condition, units, and names that protobuf does not allow
  const fields = channels.map(({ name, unit }) => {
    const field = Object.keys(type.fields).find((field) => (notes.get(`name.${field}`) ?? field) === name);
    if (!field) throw new Error(`the log has no channel ${name}`);
    const logged = notes.get(`unit.${field}`);
    if (logged !== unit) throw new Error(`${name} is in ${logged}, expected ${unit}`);
    return field;
  });
  const condition = Object.fromEntries(
    ["speed", "amplitude", "frequency", "start"].map((key) => [key, parseFloat(notes.get(key))]),
  );
  if (Object.values(condition).some(Number.isNaN)) throw new Error("the log does not say its condition");

  async function* samples() {
    for await (const { logTime, data } of reader.readMessages({ topics: [TOPIC] })) {
      const message = type.decode(data);
      yield [logTime, fields.map((field) => message[field])];
    }
  }
  return { condition, samples: samples() };
}

/** Rows of a CSV file: time, corrected, sigma, status. */
class Corrector {
  constructor(session, info, condition) {
    Object.assign(this, { session, info, condition, start: BigInt(Math.round(condition.start * 1e9)) });
    this.history = []; // the last rows before the batch, at most one less than a window
  }

  async correct(batch) {
    const { rows: length, channels, uncorrected, step_ns } = this.info;
    const all = [...this.history, ...batch];
    for (const [k, [time, values]] of all.entries()) {
      if (k && time - all[k - 1][0] !== BigInt(step_ns)) throw new Error(`at ${time} ns: another sample time`);
      if (!values.every(Number.isFinite)) throw new Error(`at ${time} ns: no finite number`);
    }
    const count = Math.max(all.length - length + 1, 0); // windows, each ending in one of the last rows
    const answer = count ? await this.run(all, count) : undefined;
    const first = all.length - count;
    this.history = all.slice(-(length - 1));

    return batch.map(([time, simulated], k) => {
      const n = k + all.length - batch.length - first; // the window that ends here
      if (n < 0) return [time, ...simulated, ...uncorrected, WARMUP];
      const at = (name) => answer[name].data.subarray(n * channels.length, (n + 1) * channels.length);
      // the double of the log and the correction of the float32 that the network saw
      const corrected = simulated.map((value, j) => value + Math.fround(at("corrected")[j] - Math.fround(value)));
      return [time, ...corrected, ...at("sigma"), answer.in_envelope.data[n] >= 1 ? OK : OUTSIDE];
    });
  }

  run(all, count) {
    const { rows: length, channels } = this.info;
    const size = length * channels.length;
    const values = Float32Array.from(all.flatMap(([, row]) => row));
    const window = new Float32Array(count * size);
    const condition = new Float32Array(count * 3);
    const time = new Float64Array(count); // s since the excitation began
    for (let n = 0; n < count; n++) {
      window.set(values.subarray(n * channels.length, n * channels.length + size), n * size);
      condition.set([this.condition.speed, this.condition.amplitude, this.condition.frequency], n * 3);
      time[n] = Number(all[n + length - 1][0] - this.start) / 1e9;
    }
    return this.session.run({
      window: new ort.Tensor("float32", window, [count, length, channels.length]),
      condition: new ort.Tensor("float32", condition, [count, 3]),
      time: new ort.Tensor("float64", time, [count, 1]),
    });
  }
}

const [bundle, log, out] = process.argv.slice(2);
if (!out) {
  console.error("usage: node correct.mjs corrector.onnx run.mcap corrected.csv");
  process.exit(2);
}
const model = await readFile(bundle);
const info = readInfo(model);
if (info.state || info.sees) throw new Error("this corrector has a state, or sees more than its channels: not shown here");
const file = await open(log);
const { condition, samples } = await openLog(file, info.channels);
const corrector = new Corrector(await ort.InferenceSession.create(model), info, condition);

const csv = await open(out, "w");
const named = (suffix) => info.channels.map(({ name, unit }) => `${name}_${suffix} [${unit}]`);
await csv.write(`${["time", ...named("corrected"), ...named("sigma"), "corrector_status"].join()}\n`);
const seconds = (ns) => `${ns / 1_000_000_000n}.${String(ns % 1_000_000_000n).padStart(9, "0")}`;
let batch = [];
const flush = async () => {
  const lines = (await corrector.correct(batch)).map(([time, ...values]) => `${seconds(time)},${values.join()}\n`);
  await csv.write(lines.join(""));
  batch = [];
};
for await (const sample of samples) if (batch.push(sample) === BATCH) await flush();
if (batch.length) await flush();
await csv.close();
await file.close();
