// Buttons and fields from the JSON Schema of steps: whatever a file can say can be pressed here.

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

// An input for a value of a schema: the element, and a way to read it.
function input(schema, defs, label) {
  const own = resolve(schema, defs);
  const types = [own.type].flat();
  const words = wordsOf(own, defs);
  if (words) {
    const element = document.createElement("select");
    if (own.default === undefined) element.append(new Option("", ""));
    for (const word of words) element.append(new Option(word, word, word === own.default, word === own.default));
    return { element, read: () => element.value || undefined };
  }
  if (types.includes("boolean")) {
    const element = document.createElement("input");
    element.type = "checkbox";
    element.checked = own.default ?? false;
    return { element, read: () => element.checked };
  }
  if (own.properties) return fieldset(own, defs, label);
  const element = document.createElement("input");
  const example = own.examples?.[0] ?? own.default;
  if (own.default !== undefined && own.default !== null) element.value = typeof own.default === "object" ? JSON.stringify(own.default) : own.default;
  else if (example !== undefined) element.placeholder = typeof example === "object" ? JSON.stringify(example) : example;
  const plain = types.includes("string") && !types.includes("array");
  if (!plain && types.some((type) => type === "array" || type === "object")) element.placeholder ||= types.includes("array") ? "[…]" : "{…}";
  return {
    element,
    read: () => {
      const text = element.value.trim();
      if (text === "") return undefined;
      if (plain) return text;
      try { return JSON.parse(text); } catch { return text; }
    },
  };
}

function fieldset(schema, defs, label) {
  const element = document.createElement("fieldset");
  const legend = document.createElement("legend");
  legend.textContent = label;
  element.append(legend);
  const read = fields(element, schema, defs, []);
  return { element, read };
}

// The fields of a table; gives a way to read them all.
function fields(place, schema, defs, without) {
  const readers = [];
  for (const [name, property] of Object.entries(schema.properties ?? {})) {
    if (without.includes(name)) continue;
    const field = input(property, defs, name);
    field.element.title = property.description ?? "";
    if (field.element.tagName !== "FIELDSET") {
      const label = document.createElement("label");
      label.textContent = schema.required?.includes(name) ? `${name} *` : name;
      label.title = property.description ?? "";
      field.element.setAttribute("aria-label", name);
      place.append(label);
    }
    place.append(field.element);
    readers.push([name, field.read]);
  }
  return () => {
    const table = {};
    for (const [name, read] of readers) {
      const value = read();
      if (value !== undefined && value !== false) table[name] = value;
    }
    return table;
  };
}

// A form that does something when it is sent; `make` gives the step.
function form(title, about, build, send) {
  const element = document.createElement("form");
  element.className = "form";
  const button = document.createElement("button");
  button.textContent = title;
  button.title = about;
  const place = document.createElement("div");
  place.className = "fields";
  const make = build(place);
  const problem = document.createElement("p");
  problem.className = "problem";
  problem.hidden = true;
  if (place.childElementCount) {
    const text = document.createElement("p");
    text.className = "about";
    text.textContent = about;
    element.append(text, place);
  } else {
    element.classList.add("simple");
  }
  element.append(button, problem);
  element.addEventListener("submit", async (event) => {
    event.preventDefault();
    problem.hidden = true;
    try { await send(make()); } catch (error) { problem.textContent = error.message; problem.hidden = false; }
  });
  element.dataset.title = title;
  return element;
}

// The forms of everything that people can do to a device.
export function operatorForms(schema, able, send) {
  const { $defs: defs } = schema;
  return alternatives(defs.OperatorText, defs).filter(([name]) => able.includes(name)).map(([name, one]) => {
    const about = one.description ?? "";
    const title = name.replaceAll("_", " ");
    const property = one.properties?.[name];
    if (!property) return form(title, about, () => () => ({ operator: name }), send);
    const own = resolve(property, defs);
    if (own.type === "boolean") return toggle(name, title, about, send);
    return form(title, about, (place) => {
      const table = own.properties ? fields(place, own, defs, []) : one_field(place, property, defs, name);
      return () => ({ operator: { [name]: table() } });
    }, send);
  });
}

function one_field(place, property, defs, name) {
  const field = input(property, defs, name);
  field.element.setAttribute("aria-label", name);
  place.append(field.element);
  return field.read;
}

// In or out, as a button.
function toggle(name, title, about, send) {
  const element = document.createElement("div");
  element.className = "form simple forms";
  for (const [word, value] of [["", true], [" off", false]]) {
    element.append(form(`${title}${word}`, about, () => () => ({ operator: { [name]: value } }), send));
  }
  element.dataset.title = title;
  return element;
}

// The forms of all faults that a device can have.
export function faultForms(schema, faults, kind, send) {
  const { $defs: defs } = schema;
  const forms = new Map(alternatives(defs.Fault, defs).map(([, one]) => [one.properties.kind.const, one]));
  return faults.filter((fault) => fault.devices.includes(kind)).map((fault) => {
    const one = forms.get(fault.kind);
    const element = document.createElement("details");
    element.className = "form";
    element.dataset.title = `${fault.kind} ${one.description ?? ""}`;
    const summary = document.createElement("summary");
    summary.textContent = fault.kind;
    summary.title = one.description ?? "";
    element.append(summary);
    const own = form("Break it", one.description ?? "", (place) => {
      const table = fields(place, one, defs, ["kind"]);
      const label = document.createElement("label");
      label.textContent = "for";
      label.title = "How long it lasts; until it is cleared unless given.";
      const lasts = document.createElement("input");
      lasts.placeholder = "until cleared";
      lasts.setAttribute("aria-label", "for");
      place.append(label, lasts);
      return () => ({
        fault: { kind: fault.kind, ...table() },
        ...(lasts.value.trim() ? { for: lasts.value.trim() } : {}),
      });
    }, send);
    element.append(own);
    return element;
  });
}

// Name and schema of each alternative of a `oneOf`.
function alternatives(schema, defs) {
  return (schema?.oneOf ?? []).flatMap((one) => {
    const own = resolve(one, defs);
    if (own.const !== undefined) return [[own.const, own]];
    if (own.enum) return own.enum.map((word) => [word, { description: own.description }]);
    return [[Object.keys(own.properties ?? {})[0], own]];
  });
}
