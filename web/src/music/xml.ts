/** A small reader of XML, for pages and node alike: elements, attributes and text, without namespaces. */

/** An element. */
export class XmlElement {
  readonly children: XmlElement[] = [];
  text = "";

  constructor(
    readonly tag: string,
    private readonly attributes: ReadonlyMap<string, string>,
  ) {}

  /** Return an attribute, empty if there is none. */
  attribute(name: string): string {
    return this.attributes.get(name) ?? "";
  }

  /** Return all elements at a path of tags, such as `notations/tied`. */
  all(path: string): XmlElement[] {
    return path
      .split("/")
      .reduce<XmlElement[]>((found, tag) => found.flatMap((one) => one.children.filter((two) => two.tag === tag)), [this]);
  }

  /** Return the first element at a path. */
  first(path: string): XmlElement | undefined {
    return this.all(path)[0];
  }

  /** Return the text of the first element at a path, empty if there is none. */
  textAt(path: string): string {
    return this.first(path)?.text.trim() ?? "";
  }
}

const TOKEN = /<!--[^]*?-->|<\?[^]*?\?>|<!\[CDATA\[([^]*?)\]\]>|<!(?:[^[>]|\[[^\]]*\])*>|<(\/?)([^\s/>]+)([^>]*?)(\/?)>|[^<]+/g;
const ATTRIBUTE = /([^\s=]+)\s*=\s*(?:"([^"]*)"|'([^']*)')/g;
const ENTITIES: Readonly<Record<string, string>> = { lt: "<", gt: ">", amp: "&", quot: '"', apos: "'" };

/** Read a document; return its root. @throws Error If its elements do not fit into each other. */
export function parseXml(text: string): XmlElement {
  const top = new XmlElement("", new Map());
  const open = [top];
  for (const [token, data, closes, name, rest, isEmpty] of text.matchAll(TOKEN)) {
    const parent = open.at(-1)!;
    if (data !== undefined) parent.text += data;
    else if (!token.startsWith("<")) parent.text += plain(token);
    else if (name === undefined) continue;
    else if (closes) {
      if (open.length === 1 || parent.tag !== local(name)) throw new Error(`</${name}> ends what is <${parent.tag}>`);
      open.pop();
    } else {
      const pairs = [...rest.matchAll(ATTRIBUTE)].map(([, key, one, two]): [string, string] => [local(key), plain(one ?? two)]);
      const element = new XmlElement(local(name), new Map(pairs));
      parent.children.push(element);
      if (!isEmpty) open.push(element);
    }
  }
  if (open.length > 1) throw new Error(`<${open.at(-1)!.tag}> does not end`);
  if (top.children.length !== 1) throw new Error("it has no root");
  return top.children[0];
}

function local(name: string): string {
  return name.slice(name.indexOf(":") + 1);
}

function plain(text: string): string {
  return text.replace(/&(#x?[\da-f]+|\w+);/gi, (whole, name: string) => {
    if (!name.startsWith("#")) return ENTITIES[name] ?? whole;
    return String.fromCodePoint(/^#x/i.test(name) ? parseInt(name.slice(2), 16) : Number(name.slice(1)));
  });
}
