// Buttons and fields from the JSON Schema of steps: what a file can say can be pressed here.

// `#/$defs/Name` and all that leads to it.
function resolve(schema, defs) {
  let found = schema;
  for (let steps = 0; found?.$ref && steps < 10; steps += 1) {
    const { $ref, ...own } = found;
    found = { ...defs[$ref.split("/").at(-1)], ...own };
  }
  const real = (found.anyOf ?? []).filter((one) => one.type !== "null");
  return real.length === 1 ? { ...resolve(real[0], defs), ...found, anyOf: undefined } : found;
}

// The words that a schema allows, if it allows nothing else.
function wordsOf(schema, defs) {
  const own = resolve(schema, defs);
  if (own.const !== undefined) return [own.const];
  if (own.enum) return own.enum;
  const parts = (own.oneOf ?? own.anyOf ?? []).map((one) => wordsOf(one, defs));
  return parts.length && parts.every(Boolean) ? [...new Set(parts.flat())] : null;
}

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

// What holds if it is left out, as its description says: "Direction; default both."
const usually = (schema) => /; default (.+?)\.(?:\s|$)/.exec(schema.description ?? "")?.[1] ?? "";

// An input for a value of a schema: the element, and a function that reads it.
function input(schema, defs, label, isRequired) {
  const own = resolve(schema, defs);
  const types = [own.type].flat();
  const words = wordsOf(own, defs);
  if (words) {
    const element = make("select", { required: isRequired });
    const usual = usually(own);
    if (own.default === undefined) element.append(new Option(isRequired ? "choose" : usual && `${usual} (default)`, ""));
    for (const word of words) element.append(new Option(word, word, word === own.default, word === own.default));
    return { element, read: () => element.value || undefined };
  }
  if (types.includes("boolean")) {
    const element = make("input", { type: "checkbox", checked: own.default ?? false });
    // What is the default may be left out.
    return { element, read: () => (element.checked === (own.default ?? false) ? undefined : element.checked) };
  }
  if (types.includes("array")) return list(own, defs, label);
  if (own.properties) return group(own, defs, label);
  const element = make("input", { required: isRequired, autocomplete: "off" });
  if (own.default !== undefined && own.default !== null) element.value = own.default;
  else element.placeholder = usually(own) || (own.examples?.[0] ?? "");
  if (types.includes("integer") || types.includes("number")) element.inputMode = "decimal";
  const isText = types.includes("string");
  return {
    element,
    read: () => {
      const text = element.value.trim();
      if (text === "") return undefined;
      if (isText) return text;
      try { return JSON.parse(text); } catch { return text; }
    },
  };
}

// A box for each word of a list of words; a field for each item of a list whose length is known.
function list(schema, defs, label) {
  const element = make("fieldset", { className: "list" }, make("legend", { textContent: label }));
  const words = wordsOf(schema.items ?? {}, defs);
  if (words) {
    const boxes = words.map((word) => {
      const box = make("input", { type: "checkbox", value: word, checked: schema.default?.includes(word) ?? false });
      element.append(make("label", {}, box, ` ${word}`));
      return box;
    });
    return { element, read: () => boxes.filter((box) => box.checked).map((box) => box.value) };
  }
  const count = schema.maxItems ?? 1;
  const items = Array.from({ length: count }, (_, at) => {
    const item = input({ ...schema.items, default: schema.default?.[at] }, defs, `${label} ${at + 1}`, true);
    item.element.setAttribute("aria-label", `${label} ${at + 1}`);
    element.append(item.element);
    return item;
  });
  return { element, read: () => items.map((item) => item.read()) };
}

function group(schema, defs, label) {
  const element = make("fieldset", {}, make("legend", { textContent: label }));
  const read = fields(element, schema, defs, []);
  return { element, read };
}

// Adds the fields of a table; returns a function that reads them all.
function fields(place, schema, defs, without) {
  const readers = [];
  for (const [name, property] of Object.entries(schema.properties ?? {})) {
    if (without.includes(name)) continue;
    // Where there is no choice there is no field.
    if (wordsOf(property, defs)?.length === 1) continue;
    const isRequired = schema.required?.includes(name) ?? false;
    const field = input(property, defs, name.replaceAll("_", " "), isRequired);
    field.element.title = property.description ?? "";
    if (field.element.tagName === "FIELDSET") place.append(field.element);
    else {
      const words = name.replaceAll("_", " ");
      field.element.setAttribute("aria-label", words);
      place.append(make("label", { textContent: isRequired ? `${words} *` : words, title: property.description ?? "" }), field.element);
    }
    readers.push([name, field.read]);
  }
  return () => Object.fromEntries(readers.map(([name, read]) => [name, read()]).filter(([, value]) => value !== undefined));
}

// A form that does something when it is sent; `build` puts its fields into a place and returns a function that makes the step.
function form(title, about, build, send) {
  const button = make("button", { textContent: title, title: about });
  const place = make("div", { className: "fields" });
  const step = build(place);
  const problem = make("p", { className: "problem", hidden: true });
  problem.setAttribute("role", "alert");
  const element = make("form", { className: "form" });
  if (place.childElementCount) element.append(place);
  else element.classList.add("simple");
  element.append(button, problem);
  element.addEventListener("submit", async (event) => {
    event.preventDefault();
    problem.hidden = true;
    try { await send(step()); } catch (error) { problem.textContent = error.message; problem.hidden = false; }
  });
  return element;
}

// What opens to show a form.
function folded(title, about, ...children) {
  const element = make("details", { className: "fold" }, make("summary", { textContent: title, title: about }));
  element.dataset.name = title;
  element.dataset.title = `${title} ${about}`;
  element.append(make("p", { className: "about", textContent: about }), ...children);
  return element;
}

// The forms of everything that people can do to a device: first what takes a press, then what has fields.
export function operatorForms(schema, able, send) {
  const { $defs: defs } = schema;
  const simple = make("div", { className: "forms" });
  const others = [];
  for (const [name, one] of alternatives(defs.OperatorText, defs)) {
    if (!able.includes(name)) continue;
    const about = (one.description ?? "").replace(/^R150: /, "");
    const title = name.replaceAll("_", " ");
    const property = one.properties?.[name];
    const own = property && resolve(property, defs);
    const does = (value) => () => ({ operator: value });
    if (!property) simple.append(form(title, about, () => does(name), send));
    else if (own.type === "boolean") {
      for (const [word, value] of [["", true], [" off", false]]) {
        simple.append(form(`${title}${word}`, about, () => does({ [name]: value }), send));
      }
    } else if (wordsOf(own, defs)) {
      for (const word of wordsOf(own, defs)) simple.append(form(`${title} ${word}`, about, () => does({ [name]: word }), send));
    } else {
      const upper = title[0].toUpperCase() + title.slice(1);
      others.push(folded(title, about, form(upper, about, (place) => {
        const read = fields(place, own, defs, []);
        return () => ({ operator: { [name]: read() } });
      }, send)));
    }
  }
  return [simple, ...others];
}

// The forms of all faults that a device with so many links can have.
export function faultForms(schema, faults, kind, links, send) {
  const { $defs: defs } = schema;
  const forms = new Map(alternatives(defs.Fault, defs).map(([, one]) => [one.properties.kind.const, one]));
  const own = faults.filter((fault) => fault.devices.includes(kind) && forms.has(fault.kind));
  // Two devices may have faults of one name.
  const kinds = new Map(own.map((fault) => [fault.kind, fault]));
  return [...kinds.values()].map((fault) => {
    const one = forms.get(fault.kind);
    const sees = make("p", { className: "about", textContent: `The client sees: ${fault.sees}` });
    return folded(fault.kind, fault.summary, sees, form("Inject", fault.summary, (place) => {
      const read = fields(place, one, defs, links > 1 ? ["kind"] : ["kind", "link"]);
      const about = "How long it lasts; default until it is cleared.";
      const lasts = make("input", { placeholder: "until cleared", title: about, autocomplete: "off" });
      lasts.setAttribute("aria-label", "for");
      place.append(make("label", { textContent: "for", title: about }), lasts);
      return () => ({
        fault: { kind: fault.kind, ...read() },
        ...(lasts.value.trim() ? { for: lasts.value.trim() } : {}),
      });
    }, send));
  });
}

// Name and schema of each alternative of an `anyOf`.
function alternatives(schema, defs) {
  return (schema?.anyOf ?? []).flatMap((one) => {
    const own = resolve(one, defs);
    if (own.const !== undefined) return [[own.const, own]];
    if (own.enum) return own.enum.map((word) => [word, { description: own.description }]);
    return [[Object.keys(own.properties ?? {})[0], own]];
  });
}
